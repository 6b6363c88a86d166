"""The twin's turn shown by the SDK's emulated camera: scanned and processed as with hardware."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp.scanner.axes import SimulatedAxis
from depthwarp.scanner.axis import Axis
from depthwarp.scanner.frames import FrameSource, PixelFormat
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.processing import process_recording
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.scan import run_scan
from depthwarp.scanner.sources import BaslerSource
from depthwarp.scanner.sources.mounting import upright_format
from depthwarp.scanner.twin import (
    Scene,
    TwinCamera,
    TwinRenderer,
    render_turn_to_folder,
    turn_shots,
)
from depthwarp.scanner.twin.session import TWIN_POSITION, twin_calibration
from tests.scanner.sources.pictures import BAYER

EXPOSURE_US = 2000.0
PLAN = ScanPlan.turn(8, exposures_us=(EXPOSURE_US,), settle_s=0.0, frame_timeout_s=30.0)
"""With patience: after a timeout the emulated camera begins its folder again."""


@pytest.fixture(scope="module")
def renderer() -> TwinRenderer:
    """The twin's room at an eighth of the sensor's size."""
    return TwinRenderer(Scene(furnished_room()), reference_geometry(0.125), TWIN_POSITION)


def scan(
    folder: Path, source: FrameSource, axis: Axis, renderer: TwinRenderer
) -> tuple[Recording, bytes]:
    """Scan, process, and return the recording and the bytes of its cloud."""
    with source, axis:
        info = source.open()
        recording = Recording.create(folder, PLAN, info, {"position": list(TWIN_POSITION)})
        axis.reference()
        run_scan(recording, source, axis)
    result = process_recording(recording, twin_calibration(renderer, info))
    result.cloud.save(folder / "cloud.ply")
    assert result.counts.points > 1000 and result.counts.stops_without_line == 0
    return recording, (folder / "cloud.ply").read_bytes()


@pytest.fixture(scope="module")
def direct(
    tmp_path_factory: pytest.TempPathFactory, renderer: TwinRenderer
) -> tuple[Recording, bytes]:
    """The scan with the twin's own camera."""
    axis = SimulatedAxis()
    folder = tmp_path_factory.mktemp("direct")
    return scan(folder, TwinCamera(renderer, axis), axis, renderer)


def emulated(turn: Path, raw_size: tuple[int, int], rotation: int) -> BaslerSource:
    """The SDK's camera that shows a folder of mosaics, mounted so that they come out RGGB."""
    (raw_format,) = (
        pattern
        for pattern in BAYER
        if upright_format(pattern, raw_size, rotation) is PixelFormat.BAYER_RGGB
    )
    return BaslerSource(
        rotation=rotation,
        pixel_format=raw_format,
        bits=8,
        features={
            "Width": raw_size[0],
            "Height": raw_size[1],
            "TestImageSelector": "Off",
            "ImageFileMode": "On",
            "ImageFilename": str(turn),
        },
    )


@pytest.mark.parametrize("rotation", [0, 90])
def test_the_emulated_camera_gives_the_twins_cloud(
    direct: tuple[Recording, bytes],
    renderer: TwinRenderer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rotation: int,
) -> None:
    """Files, SDK, trigger, mounting, recording and processing: frames and cloud byte for byte."""
    reason = "pypylon is not installed: pip install pypylon runs the camera tests in emulation"
    pytest.importorskip("pypylon.pylon", reason=reason)
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    recorded, cloud = direct
    angles = [step.reported for step in recorded.steps()]
    files = render_turn_to_folder(renderer, turn_shots(PLAN, angles), tmp_path / "turn")
    width, height = renderer.geometry.lens.size
    if rotation == 90:  # a camera rolled clockwise sees the scene turned the other way
        for file in files:
            upright = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            assert upright is not None
            cv2.imwrite(str(file), cv2.rotate(upright, cv2.ROTATE_90_COUNTERCLOCKWISE))
        width, height = height, width
    source = emulated(tmp_path / "turn", (width, height), rotation)
    shown, shown_cloud = scan(tmp_path / "scan", source, SimulatedAxis(), renderer)
    assert shown.source.name == "Basler Emulation"
    assert shown.source.pixel_format is PixelFormat.BAYER_RGGB
    for ours, theirs in zip(shown.steps(), recorded.steps(), strict=True):
        assert ours.reported == theirs.reported
        for name, frame in theirs.frames.items():
            np.testing.assert_array_equal(ours.frames[name].pixels, frame.pixels)
            assert ours.frames[name].exposure_us == EXPOSURE_US
    assert shown_cloud == cloud
