"""NPZ: `points` and one array an attribute; damaged archives and headers that lie."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def npy_with_header(header, payload=b"", version=b"\x01\x00"):
    """A .npy file of this header's text."""
    text = header.encode() + b"\n"
    size = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + size + text + payload


def zipped(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            archive.writestr(name + ".npy", content)
    return stream.getvalue()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_files_that_numpy_wrote(scratch, save):
    stream = io.BytesIO()
    save(stream, points=POINTS, color=np.ones((4, 3), np.uint8), time=np.arange(4.0))
    cloud = dw.read(scratch("numpy.npz", stream.getvalue()))
    np.testing.assert_array_equal(cloud.points_world, POINTS)
    assert {n: (v.dtype, v.shape) for n, v in cloud.attributes.items()} == {
        "color": (np.dtype(np.uint8), (4, 3)),
        "time": (np.dtype(np.float64), (4,)),
    }
    cloud.attributes["time"][0] = 1.0  # arrays can be written to, not views of the file's bytes


@pytest.mark.parametrize(
    "points",
    [
        POINTS.astype(">f4"),
        POINTS.astype(np.float64),
        POINTS.astype(np.int16),
        np.asfortranarray(POINTS),
    ],
)
def test_other_kinds_of_points(scratch, points):
    cloud = dw.read(scratch("kinds.npz", npz(points=points, big=np.arange(4, dtype=">i8"))))
    np.testing.assert_array_equal(cloud.points_world, POINTS)
    assert cloud.points_world.flags.c_contiguous
    assert cloud.attributes["big"].dtype.isnative
    np.testing.assert_array_equal(cloud.attributes["big"], range(4))


@pytest.mark.parametrize("count", [0, 1])
def test_zero_and_one_point(scratch, count):
    cloud = dw.read(scratch("few.npz", npz(points=POINTS[:count], ring=np.arange(count))))
    assert cloud.points_world.shape == (count, 3)
    assert cloud.attributes["ring"].shape == (count,)


def test_map_coordinates_need_an_offset(scratch):
    path = scratch("utm.npz", npz(points=np.array([[500_000.123, 5_400_000.456, 1.5]])))
    with pytest.raises(InputError, match=r"utm\.npz.*offset"):
        dw.read(path)
    cloud = dw.read(path, offset=(5e5, 5.4e6, 0))
    np.testing.assert_allclose(cloud.points_world, [[0.123, 0.456, 1.5]], atol=1e-7)


@given(
    points=hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(3))),
    dtype=hnp.boolean_dtypes()
    | hnp.integer_dtypes(endianness="=")
    | hnp.unsigned_integer_dtypes(endianness="=")
    | hnp.floating_dtypes(endianness="=", sizes=(16, 32, 64))
    | hnp.unicode_string_dtypes(endianness="=", min_len=1, max_len=5),
    name=st.sampled_from(["color", "file", "allow_pickle", "größe", "two words", "time"]),
    width=st.integers(1, 3),
    data=st.data(),
)
def test_writing_then_reading_keeps_every_bit(scratch, points, dtype, name, width, data):
    values = data.draw(hnp.arrays(dtype, (len(points), width)))
    path = scratch("round.npz", b"")
    dw.PointCloud(points, {name: values}).save(path)
    back = dw.read(path)
    assert back.points_world.tobytes() == points.tobytes()
    assert list(back.attributes) == [name]
    assert back.attributes[name].dtype == values.dtype
    assert back.attributes[name].tobytes() == values.tobytes()


def test_numpy_reads_what_is_written(tmp_path):
    dw.PointCloud(POINTS, {"ring": np.arange(4)}).save(tmp_path / "cloud.npz")
    with np.load(tmp_path / "cloud.npz") as arrays:
        assert sorted(arrays) == ["points", "ring"]
        np.testing.assert_array_equal(arrays["points"], POINTS)
    assert [p.name for p in tmp_path.iterdir()] == ["cloud.npz"]


def test_python_objects_are_neither_written_nor_read(scratch, tmp_path):
    cloud = dw.PointCloud(POINTS[:1], {"names": np.array([{"a": 1}], object)})
    with pytest.raises(InputError, match="'names' holds Python objects"):
        cloud.save(tmp_path / "objects.npz")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileFormatError, match=r"names\.npy holds Python objects"):
        dw.read(scratch("objects.npz", npz(points=POINTS, names=np.array([{}] * 4, object))))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"xyz": POINTS, "ring": np.arange(4)}, "no array 'points'; it has xyz, ring"),
        ({}, "no array 'points'; it has no arrays"),
        ({"points": POINTS.T}, r"shape \(N, 3\), got \(3, 4\)"),
        ({"points": POINTS.ravel()}, r"shape \(N, 3\), got \(12,\)"),
        ({"points": POINTS.astype(complex)}, "x must be real numbers"),
        ({"points": POINTS.astype(str)}, "x must be real numbers"),
        ({"points": POINTS, "ring": np.arange(3)}, "'ring' must have 4 rows"),
        ({"points": POINTS, "pose": np.eye(4)[0, 0]}, "'pose' must have 4 rows"),
    ],
)
def test_arrays_that_are_no_cloud(scratch, arrays, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.read(scratch("other.npz", npz(**arrays)))
    assert "other.npz" in str(caught.value)


@pytest.mark.parametrize(
    "member",
    [
        b"",
        b"hello",
        b"\x93NUMPY",
        b"\x93NUMPY\x01\x00",
        npy_with_header("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3)}"),
        npy_with_header(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1" + "0" * 40 + ", 3)}"
        ),
        npy_with_header("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -3)}", b"0" * 12),
        npy_with_header("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3)}", b"0" * 11),
        npy_with_header("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3)}", b"0" * 13),
        npy_with_header("{'descr': 'V0', 'fortran_order': False, 'shape': (1, 3)}"),
        npy_with_header("{'descr': '<q9', 'fortran_order': False, 'shape': (1, 3)}"),
        npy_with_header("{'descr': '<f4', 'shape': (1, 3)}"),
        npy_with_header("{'descr': '<f4', 'shape': ("),
        npy_with_header("{{}: 1}"),
        npy_with_header("[" * 9000),
        npy_with_header(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 3)}", b"", b"\x03\0"
        ),
        npy_with_header(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (0, 3)}", b"", b"\x09\0"
        ),
    ],
)
def test_members_that_are_no_array(scratch, member):
    with pytest.raises(FileFormatError, match="member.npz"):
        dw.read(scratch("member.npz", zipped(points=member)))


def test_a_header_that_claims_too_many_points(scratch):
    header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3)}"
    message = r"claims shape \(1000000000000, 3\) \(12000000000000 bytes\), the file holds 0"
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("huge.npz", zipped(points=npy_with_header(header))))


def test_archives_that_are_damaged(scratch):
    content = npz(points=POINTS)
    for cut in (1, 10, 100, len(content) - 1):
        with pytest.raises(FileFormatError, match="not a readable NPZ.*copy the file again"):
            dw.read(scratch("cut.npz", content[:cut]))
    flipped = bytearray(content)
    flipped[content.index(POINTS.tobytes()[:16]) + 5] ^= 1
    with pytest.raises(FileFormatError, match="not a readable NPZ.*CRC"):
        dw.read(scratch("flipped.npz", bytes(flipped)))
    with pytest.raises(FileFormatError, match="not a readable NPZ"):
        dw.read(scratch("plain.npz", b"not a zip file"))
