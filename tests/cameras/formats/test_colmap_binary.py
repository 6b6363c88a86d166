"""cameras.bin and images.bin: the layout byte by byte, and damage of every kind."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import pytest

from depthwarp.cameras.formats import colmap_binary
from depthwarp.cameras.formats.colmap_model import CameraRecord, ImageRecord
from depthwarp.errors import FileFormatError

CAMERAS = struct.pack("<QIiQQ4d", 1, 3, 1, 640, 480, 500, 510, 320, 240)
POINTS = struct.pack("<QddqddQ", 2, 1.5, 2.5, -1, 3.5, 4.5, 18)
IMAGES = (
    struct.pack("<QI7dI", 2, 7, 1, 0, 0, 0, 0.5, -1, 2000, 3)
    + "dir/ü b.png\0".encode()
    + POINTS
    + struct.pack("<I7dI", 8, 0, 1, 0, 0, 0, 0, 0, 3)
    + b"b\0"
    + struct.pack("<Q", 0)
)


def written(folder: Path, content: bytes) -> Path:
    path = folder / "file.bin"
    path.write_bytes(content)
    return path


def test_the_layout_of_cameras(tmp_path: Path) -> None:
    """Count, then number, model, width, height and parameters, little endian, unpadded."""
    expected = CameraRecord(3, "PINHOLE", 640, 480, (500, 510, 320, 240))
    assert colmap_binary.read_cameras(written(tmp_path, CAMERAS)) == [expected]
    colmap_binary.write_cameras([expected], tmp_path / "out.bin")
    assert (tmp_path / "out.bin").read_bytes() == CAMERAS


def test_the_layout_of_images(tmp_path: Path) -> None:
    """Count, then number, pose, camera, name up to a zero, and 2D points, which are skipped."""
    expected = [
        ImageRecord(7, (1, 0, 0, 0), (0.5, -1, 2000), 3, "dir/ü b.png"),
        ImageRecord(8, (0, 1, 0, 0), (0, 0, 0), 3, "b"),
    ]
    assert colmap_binary.read_images(written(tmp_path, IMAGES)) == expected
    colmap_binary.write_images(expected, tmp_path / "out.bin")
    assert (tmp_path / "out.bin").read_bytes() == IMAGES.replace(POINTS, bytes(8))


@pytest.mark.parametrize(
    ("content", "read"),
    [(CAMERAS, colmap_binary.read_cameras), (IMAGES, colmap_binary.read_images)],
)
def test_every_cut_is_found(tmp_path: Path, content: bytes, read: object) -> None:
    """A file that was cut anywhere, or has a byte too many, is refused."""
    for end in range(len(content)):
        with pytest.raises(FileFormatError, match="cut short|empty"):
            read(written(tmp_path, content[:end]))
    with pytest.raises(FileFormatError, match="1 bytes are left behind the last"):
        read(written(tmp_path, content + b"\0"))


@pytest.mark.parametrize("read", [colmap_binary.read_cameras, colmap_binary.read_images])
def test_a_huge_count_allocates_nothing(tmp_path: Path, read: object) -> None:
    """A header that claims 2^60 records is refused at once."""
    path = written(tmp_path, struct.pack("<Q", 2**60) + bytes(500))
    tracemalloc.start()
    with pytest.raises(FileFormatError, match=f"holds {2**60} .* its size is enough for"):
        read(path)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_a_huge_number_of_points_is_refused(tmp_path: Path) -> None:
    """An image that claims more 2D points than the file has room for."""
    start = IMAGES.index(POINTS)
    damaged = IMAGES[:start] + struct.pack("<Q", 2**62) + IMAGES[start + 8 :]
    with pytest.raises(FileFormatError, match=f"within the {2**62} points of image 1"):
        colmap_binary.read_images(written(tmp_path, damaged))


@pytest.mark.parametrize(
    ("model", "name"),
    [
        (7, "FOV is not supported"),
        (10, "THIN_PRISM_FISHEYE is not supported"),
        (-1, "number -1 is not known"),
        (99, "number 99 is not known"),
    ],
)
def test_unknown_models_are_named(tmp_path: Path, model: int, name: str) -> None:
    """A camera model that is no lens here: its name, or its number if it has none."""
    content = struct.pack("<QIiQQ5d", 1, 3, model, 640, 480, 500, 500, 320, 240, 1)
    with pytest.raises(FileFormatError, match=f"camera 1 of the file: .* model {name}"):
        colmap_binary.read_cameras(written(tmp_path, content))


@pytest.mark.parametrize("name", [b"", b"\xff\xfe", b"a" * 5000])
def test_bad_names_are_refused(tmp_path: Path, name: bytes) -> None:
    """Empty names, what is no text, and what does not end."""
    head, tail = IMAGES.split("dir/ü b.png".encode())
    with pytest.raises(FileFormatError, match="image 1 of the file: no name"):
        colmap_binary.read_images(written(tmp_path, head + name + tail))


def test_text_is_not_binary(tmp_path: Path) -> None:
    """A text file under a binary name is refused by its impossible count."""
    text = b"# Camera list with one line of data per camera:\n1 PINHOLE 640 480 500 500 320 240\n"
    with pytest.raises(FileFormatError, match="no cameras.bin of COLMAP"):
        colmap_binary.read_cameras(written(tmp_path, text))
