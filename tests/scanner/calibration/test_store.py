"""The calibration file: it says everything, belongs to one camera, and shows when it was edited."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.calibration import Residuals, ScannerCalibration, load_calibration
from depthwarp.scanner.frames import PixelFormat, SourceInfo
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.uncertainty import PARAMETERS, GeometryCovariance

CAMERA = SourceInfo("acA2500-14uc", "21234567", (1942, 2590), PixelFormat.BAYER_RGGB, False)


@pytest.fixture
def calibration() -> ScannerCalibration:
    root = np.random.default_rng(0).normal(0, 1e-4, (len(PARAMETERS),) * 2)
    return ScannerCalibration(
        geometry=reference_geometry(),
        covariance=GeometryCovariance(root @ root.T),
        camera_name=CAMERA.name,
        camera_serial=CAMERA.serial,
        date="2026-01-31T12:00:00+00:00",
        board="chessboard:11x8:0.06",
        residuals=Residuals(40, 7, 5000, 0.1, 0.12, 1e-4, 0.5, 6.0, 1.0, 80.0, 50.0),
    )


def test_a_saved_calibration_comes_back_to_the_last_bit(
    calibration: ScannerCalibration, tmp_path: Path
):
    """Every number survives the file, and with it the hash."""
    calibration.save(tmp_path / "c.json")
    loaded = load_calibration(tmp_path / "c.json")
    assert loaded.geometry == calibration.geometry
    assert (loaded.covariance.matrix == calibration.covariance.matrix).all()
    assert loaded.residuals == calibration.residuals
    assert loaded.camera_size == (1942, 2590)
    assert loaded.content_hash == calibration.content_hash
    assert [path.name for path in tmp_path.iterdir()] == ["c.json"]


def test_the_hash_stands_for_the_content(calibration: ScannerCalibration):
    """Any other number is another hash; the same content is the same one."""
    assert replace(calibration).content_hash == calibration.content_hash
    moved = replace(
        calibration.geometry, plane_distance=calibration.geometry.plane_distance + 1e-15
    )
    assert replace(calibration, geometry=moved).content_hash != calibration.content_hash
    assert replace(calibration, camera_serial="0").content_hash != calibration.content_hash


def test_another_camera_is_refused(calibration: ScannerCalibration):
    """Serial number, frame size and hash have to fit; the message names both sides."""
    calibration.require_camera(CAMERA)
    with pytest.raises(InputError, match="serial number 21234567, this is acA2500-14uc with 999"):
        calibration.require_camera(replace(CAMERA, serial="999"))
    with pytest.raises(InputError, match="1942 x 2590 px, the camera gives 2590 x 1942 px"):
        calibration.require_camera(replace(CAMERA, size=(2590, 1942)))
    calibration.require_hash(calibration.content_hash)
    with pytest.raises(InputError, match="the calibration with hash abc is asked for"):
        calibration.require_hash("abc")


def test_edited_numbers_break_the_hash(calibration: ScannerCalibration, tmp_path: Path):
    """A file that was changed by hand is refused."""
    path = tmp_path / "c.json"
    calibration.save(path)
    path.write_text(path.read_text().replace('"fx": 1295.0', '"fx": 1296.0'))
    with pytest.raises(FileFormatError, match="changed after it was written"):
        load_calibration(path)


def test_rewritten_but_equal_json_is_accepted(calibration: ScannerCalibration, tmp_path: Path):
    """Layout and order of keys are not content."""
    path = tmp_path / "c.json"
    calibration.save(path)
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(content.items()))))
    assert load_calibration(path).content_hash == calibration.content_hash


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "something"}, "its schema is not"),
        ({"version": 99}, "version 99 .* reads version 1"),
        ({"lens": {}}, "damaged: KeyError"),
        ({"plane": None}, "damaged: TypeError"),
        ({"plane": {"normal": [1, 0, 1], "distance": 0.5}}, "damaged: .*unit vector"),
        ({"axis": {"direction": [0, -1], "point": [0, 0, 0]}}, "damaged: ValueError: 3 numbers"),
        ({"covariance": [[1.0]]}, "damaged: .*16 x 16"),
        ({"covariance": "no"}, "damaged"),
        ({"max_range": -1.0}, "above 0"),
        ({"sha256": None}, "changed after it was written"),
        ({"residuals": {}}, "damaged: KeyError"),
    ],
)
def test_a_damaged_file_is_a_format_error(
    calibration: ScannerCalibration, tmp_path: Path, change: dict, message: str
):
    """Whatever is missing or wrong in the file is said with the file's name."""
    path = tmp_path / "c.json"
    calibration.save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileFormatError, match=message) as caught:
        load_calibration(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"\xff\xfe\x00", b"3", b'{"a": NaN}'])
def test_what_is_no_calibration_is_refused(tmp_path: Path, content: bytes):
    """Empty, cut off, binary and foreign files."""
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="not a calibration"):
        load_calibration(path)


def test_a_missing_file_is_an_input_error(tmp_path: Path):
    """The system's reason is given."""
    with pytest.raises(InputError, match="cannot read the calibration .*No such file"):
        load_calibration(tmp_path / "none.json")
