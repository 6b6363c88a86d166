"""`depthwarp replay`: a recording becomes its cloud again."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.cli.scan import report_cloud

__all__ = ["replay"]


def replay(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a recorded scan.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Cloud: ply or npz.")],
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration; the recording's own unless given.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make the cloud of a recorded scan again; the same bytes as the scan made."""
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        from depthwarp.io import check_writable
        from depthwarp.scanner.calibration import load_calibration
        from depthwarp.scanner.processing import process_recording
        from depthwarp.scanner.recording import Recording

        check_writable(output)
        recording = Recording.open(folder)
        known = load_calibration(calibration or folder / "calibration.json")
        with reporter.progress("process", "finding the line", len(recording.finished)) as update:
            result = process_recording(recording, known, progress=lambda done, _: update(done))
        result.cloud.save(output)
        report_cloud(reporter, output, asdict(result.counts))

    run_command(reporter, command)
