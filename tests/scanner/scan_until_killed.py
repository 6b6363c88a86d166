"""A scan with the fakes in a process of its own, to be killed: `python -m ... FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.scan import run_scan
from tests.scanner.fakes import FakeAxis, FakeSource

STEPS = 80


def main(folder: Path) -> None:
    """Begin or continue the scan in a folder."""
    axis = FakeAxis()
    source = FakeSource(axis, delay_s=0.002)
    if (folder / "scan.json").exists():
        recording = Recording.open(folder)
    else:
        plan = ScanPlan.turn(STEPS, exposures_us=(100.0, 400.0), settle_s=0.0)
        recording = Recording.create(folder, plan, source.info, {"calibration": None})
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    run_scan(recording, source, axis)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
