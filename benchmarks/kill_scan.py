"""Kill `depthwarp scan` at random moments and resume it: does the same cloud come out?

`python -m benchmarks.kill_scan [KILLS] [SEED] [--json FILE]` prints one line.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

STOPS = 24
SCAN = ("--stops", str(STOPS), "--twin-scale", "0.125")


@dataclass
class Outcome:
    """What became of the killed scans.

    Attributes:
        kills: Processes that were killed before they were done.
        inside_turn: Those of them that had recorded a stop, with stops still to be taken.
        scans: Scans that came to their end.
        equal: Those of them whose cloud has the bytes of the unbroken one.
    """

    kills: int = 0
    inside_turn: int = 0
    scans: int = 0
    equal: int = 0


def command(folder: Path) -> list[str]:
    """The command that begins the scan in a folder, or continues it."""
    resume = ["--resume"] if (folder / "scan.json").exists() else []
    return [sys.executable, "-m", "depthwarp", "scan", "-o", str(folder), *SCAN, *resume]


def run_unbroken(folder: Path) -> float:
    """Scan without a kill; the time it took [s]."""
    begun = time.monotonic()
    subprocess.run(command(folder), check=True, capture_output=True)
    return time.monotonic() - begun


def run_for(folder: Path, seconds: float, *, after_a_stop: bool = False) -> bool:
    """Run the command and kill it after a time; whether it was killed before its end.

    Args:
        folder: Of the recording.
        seconds: The time [s].
        after_a_stop: Count it from the first stop that this process records, not from its start.

    Raises:
        RuntimeError: It ended by itself, and badly.
    """
    before = stops_done(folder)
    process = subprocess.Popen(command(folder), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    while after_a_stop and stops_done(folder) <= before and process.poll() is None:
        time.sleep(0.001)
    try:
        _, said = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return True
    if process.returncode != 0:
        raise RuntimeError(f"the scan failed: {said.decode()}")
    return False


def stops_done(folder: Path) -> int:
    """Lines of the journal."""
    journal = folder / "journal.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def kill_scans(work: Path, kills: int, seed: int) -> Outcome:
    """Scan, kill, resume, until there were enough kills and the last scan is whole.

    Four kills in five come soon after a stop: the turn is short beside start and processing. Where
    the turn is over, every second process may come to its end.

    Args:
        work: An empty folder to work in.
        kills: How many.
        seed: Of the moments.
    """
    moments, outcome = random.Random(seed), Outcome()
    needed = run_unbroken(work / "whole")
    whole, folder = (work / "whole" / "cloud.ply").read_bytes(), work / "killed"
    while True:
        enough = outcome.kills >= kills
        before = stops_done(folder)
        spared = enough or (before == STOPS and moments.random() < 0.5)
        soon = not spared and before < STOPS and outcome.kills % 5 != 4
        moment = 600.0 if spared else moments.uniform(0.0, 0.02 if soon else needed)
        if run_for(folder, moment, after_a_stop=soon):
            outcome.kills += 1
            outcome.inside_turn += before < stops_done(folder) < STOPS
            continue
        outcome.scans += 1
        outcome.equal += (folder / "cloud.ply").read_bytes() == whole
        if enough:
            return outcome
        shutil.rmtree(folder)


def append_json_line(path: Path, seed: int, outcome: Outcome, seconds: float) -> None:
    """Append the result to a file."""
    from benchmarks.measure import machine

    record = {
        "benchmark": "kill_scan",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "stops": STOPS,
        "seed": seed,
        **asdict(outcome),
        "seconds": round(seconds, 1),
    }
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(record) + "\n")


def main() -> None:
    """Run it and say what came out."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kill_scan", description=__doc__)
    parser.add_argument("kills", type=int, nargs="?", default=50)
    parser.add_argument("seed", type=int, nargs="?", default=0, help="of the moments")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append the result to FILE")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        begun = time.monotonic()
        outcome = kill_scans(Path(work), options.kills, options.seed)
        seconds = time.monotonic() - begun
    sys.stdout.write(
        f"{outcome.kills} kills ({outcome.inside_turn} inside the turn), "
        f"{outcome.scans} scans finished, {outcome.equal} with the bytes of the unbroken one, "
        f"{seconds:.0f} s\n"
    )
    if options.json is not None:
        append_json_line(options.json, options.seed, outcome, seconds)
    raise SystemExit(outcome.equal != outcome.scans)


if __name__ == "__main__":
    main()
