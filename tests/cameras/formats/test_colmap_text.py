"""cameras.txt and images.txt: what they may look like, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from depthwarp.cameras.formats import colmap_text
from depthwarp.cameras.formats.colmap_model import CameraRecord, ImageRecord
from depthwarp.errors import FileFormatError

IMAGE = "7 1 0 0 0 0.5 -1 2e3 3 dir/a b.png"


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "file.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_line_is_a_camera(tmp_path: Path) -> None:
    """Comments, blank lines and Windows' line ends are passed over."""
    text = "\ufeff# Number of cameras: 1\r\n\r\n3 RADIAL 640 480 500 320 240 0.1 -0.01\r\n"
    expected = CameraRecord(3, "RADIAL", 640, 480, (500, 320, 240, 0.1, -0.01))
    assert colmap_text.read_cameras(written(tmp_path, text)) == [expected]


@pytest.mark.parametrize(
    "points", ["\n\n", "\n1.5 2.5 -1 3.5 2.5 18\n", "\r\n\r\n", "\n1 2 3 \n\n"]
)
@pytest.mark.parametrize("end", ["\n\n", "\n", ""])
def test_two_lines_are_an_image(tmp_path: Path, points: str, end: str) -> None:
    """The second line may hold 2D points or be empty, and after the last image be missing."""
    text = f"# comment\n{IMAGE}{points}8 0 1 0 0 0 0 0 3 b.png{end}"
    images = colmap_text.read_images(written(tmp_path, text))
    assert images == [
        ImageRecord(7, (1, 0, 0, 0), (0.5, -1, 2000), 3, "dir/a b.png"),
        ImageRecord(8, (0, 1, 0, 0), (0, 0, 0), 3, "b.png"),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 PINHOLE 640", "line 1: expected a camera .* got 3 words; the file is cut short"),
        ("#\n1 PINHOLE 640 480 500 500 320", "line 2: PINHOLE has 4 parameters .* got 3"),
        ("1 PINHOLE 640 480 500 500 320 240 0", "line 1: PINHOLE has 4 parameters .* got 5"),
        ("1 FISH 640 480 500 320 240", "line 1: the camera model FISH is not known; known"),
        (
            "1 FOV 640 480 500 500 320 240 1",
            "line 1: the camera model FOV is not supported; supported",
        ),
        ("1 PINHOLE 640 480 500 nan 320 240", "parameters must be finite numbers, got 'nan'"),
        ("1 PINHOLE 640.5 480 500 500 320 240", "the width must be a whole number, got '640.5'"),
        ("-1 PINHOLE 640 480 500 500 320 240", "camera's number must be a whole number, got '-1'"),
        ("# Number of cameras: 2\n1 PINHOLE 9 9 5 5 4 4\n", "'Number of cameras: 2' and holds 1"),
        ("", "the file is empty"),
        (b"\x01\x00\x00\x00\x00\x00\x00\x00", "not a text file"),
    ],
)
def test_bad_cameras_are_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    """Cut short, unknown, not numbers, not text: an error that names file and line."""
    path = written(tmp_path, text)
    with pytest.raises(FileFormatError, match=message) as caught:
        colmap_text.read_cameras(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("7 1 0 0 0 0.5 -1 2e3 3", "line 1: expected an image .* got 9 words; the file is cut"),
        (IMAGE.replace("0.5", "inf"), "line 1: quaternion and translation must be finite"),
        (
            IMAGE.replace(" 3 ", " x "),
            "line 1: the camera's number must be a whole number, got 'x'",
        ),
        (f"{IMAGE}\n{IMAGE}\n", "line 2: expected the 2D points of the image above"),
        (f"{IMAGE}\n8 1 0 0 0 0 0 0 3 b.png\n", "line 2: .* each image has two lines"),
        (f"{IMAGE}\n8 1 0 0 0 0 0 0 3 a b c.png\n", "line 2: expected the 2D points"),
        (f"{IMAGE}\n1.5 2.5 -1 3.5\n", "line 2: expected the 2D points of the image above"),
        (f"# Number of images: 2, mean\n{IMAGE}\n\n", "'Number of images: 2' and holds 1"),
        ("", "the file is empty"),
        (b"\xff" * 80, "not a text file"),
    ],
)
def test_bad_images_are_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    """Cut short, lines of images without lines of points, not numbers: an error with the line."""
    path = written(tmp_path, text)
    with pytest.raises(FileFormatError, match=message) as caught:
        colmap_text.read_images(path)
    assert str(path) in str(caught.value)
