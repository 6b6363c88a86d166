"""Kill `depthwarp scan` at random moments and resume it: does the same cloud come out?

`python -m benchmarks.kill_scan [KILLS] [SEED]` prints one line.
"""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

STOPS = 24
SCAN = ("--stops", str(STOPS), "--twin-scale", "0.125")


@dataclass
class Outcome:
    """What became of the killed scans.

    Attributes:
        kills: Processes that were killed before they were done.
        while_scanning: Those of them that left some stops done and some to do.
        scans: Scans that came to their end.
        equal: Those of them whose cloud has the bytes of the unbroken one.
    """

    kills: int = 0
    while_scanning: int = 0
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

    Two kills in three come soon after a stop: the turn is short beside start and processing.

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
        soon = not enough and outcome.kills % 3 != 2 and stops_done(folder) < STOPS
        moment = 600.0 if enough else moments.uniform(0.0, 0.02 if soon else needed)
        if run_for(folder, moment, after_a_stop=soon):
            outcome.kills += 1
            outcome.while_scanning += 0 < stops_done(folder) < STOPS
            continue
        outcome.scans += 1
        outcome.equal += (folder / "cloud.ply").read_bytes() == whole
        if enough:
            return outcome
        shutil.rmtree(folder)


def main() -> None:
    """Run it and say what came out."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as work:
        begun = time.monotonic()
        outcome = kill_scans(Path(work), kills, seed)
        seconds = time.monotonic() - begun
    sys.stdout.write(
        f"{outcome.kills} kills ({outcome.while_scanning} between the first and the last stop), "
        f"{outcome.scans} scans finished, {outcome.equal} with the bytes of the unbroken one, "
        f"{seconds:.0f} s\n"
    )
    raise SystemExit(outcome.equal != outcome.scans)


if __name__ == "__main__":
    main()
