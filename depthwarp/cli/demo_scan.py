"""The demo's scan: the twin's frames, its motor on a serial line, the laser line, the cloud."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depthwarp.cli.report import Reporter

if TYPE_CHECKING:
    from depthwarp.cloud import PointCloud
    from depthwarp.scanner.frames import Frame
    from depthwarp.scanner.geometry import ScannerGeometry
    from depthwarp.scanner.laser import LinePoints

__all__ = ["DemoScan", "scan_room"]

STOPS = 600
EXPOSURE_US = 2000.0

QUARTER, FULL = 0.25, 1.0
"""Sizes of the twin's sensor; the full one has 1942 x 2590 pixels."""

SHOWN_STOP = 21
"""Hundredth of the turn at which Figure 2's frame is taken: the line crosses furniture there."""


@dataclass(frozen=True)
class DemoScan:
    """What the scan leaves for the figures.

    Attributes:
        cloud: The cloud, world frame.
        geometry: The twin's geometry.
        picture: One frame with the laser on, shape (H, W, 3), uint8 BGR.
        line: The line that was found in it.
    """

    cloud: PointCloud
    geometry: ScannerGeometry
    picture: NDArray[np.uint8]
    line: LinePoints


def scan_room(reporter: Reporter, out: Path, scale: float) -> DemoScan:
    """Scan the twin's room once around.

    The raw frames are recorded as in any scan, inside `out`, and removed when the cloud is there.

    Args:
        reporter: Shows the progress.
        out: Folder for the recording.
        scale: Size of the twin's sensor, `QUARTER` or `FULL`.
    """
    from depthwarp.scanner.laser import ColorTable, LineFinder
    from depthwarp.scanner.plan import ScanPlan
    from depthwarp.scanner.processing import fit_color_model, process_recording
    from depthwarp.scanner.recording import Recording
    from depthwarp.scanner.scan import run_scan
    from depthwarp.scanner.twin.session import TWIN_POSITION, TwinScanner

    plan = ScanPlan.turn(STOPS, exposures_us=(EXPOSURE_US,), settle_s=0.0)
    with tempfile.TemporaryDirectory(prefix=".frames-", dir=out) as folder:
        with TwinScanner(scale) as twin, twin.camera as camera, twin.axis as axis:
            info = camera.open()
            settings = {"position": list(TWIN_POSITION)}
            recording = Recording.create(Path(folder) / "scan", plan, info, settings)
            width, height = info.size
            axis.reference()
            text = f"scanning a simulated room, {width} x {height} px a frame"
            with reporter.progress("scan", text, STOPS) as update:
                run_scan(recording, camera, axis, progress=lambda scan: update(scan.done))
        with reporter.stage("colour", "learning the laser's colour"):
            model = fit_color_model(recording)
        with reporter.progress("line", "finding the laser line", STOPS) as update:
            result = process_recording(
                recording, twin.calibration, model, progress=lambda done, _: update(done)
            )
        lit, off = recording.step(STOPS * SHOWN_STOP // 100).exposures[0]
        finder = LineFinder(ColorTable(model), info.size, info.pixel_format)
        return DemoScan(
            cloud=result.cloud,
            geometry=twin.calibration.geometry,
            picture=_picture(lit),
            line=finder.find(lit, off),
        )


def _picture(frame: Frame) -> NDArray[np.uint8]:
    """An RGGB mosaic as a colour picture."""
    import cv2

    return cv2.cvtColor(frame.pixels, cv2.COLOR_BayerRGGB2BGR).astype(np.uint8)
