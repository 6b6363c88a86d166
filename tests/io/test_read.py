"""`read` and `write` themselves: choice by suffix, files that are not there, damage anywhere."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import CapacityError, DepthwarpError, FileFormatError, InputError

CLOUD = dw.PointCloud(
    np.arange(12, dtype=np.float32).reshape(4, 3), {"color": np.ones((4, 3), np.uint8)}
)
READABLE = [".ply", ".pcd", ".xyz", ".txt", ".csv", ".pts", ".npz", ".bin"]


@pytest.mark.parametrize("suffix", READABLE)
def test_a_missing_file(tmp_path, suffix):
    with pytest.raises(FileNotFoundError, match=f"absent{suffix}.*no such file; check"):
        dw.read(tmp_path / f"absent{suffix}")


@pytest.mark.parametrize("suffix", READABLE)
def test_a_folder(tmp_path, suffix):
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(InputError, match=f"folder{suffix}: a folder"):
        dw.read(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("suffix", READABLE)
def test_an_empty_file(scratch, suffix):
    with pytest.raises(FileFormatError, match=r"empty \(0 bytes\)"):
        dw.read(scratch(f"empty{suffix}", b""))


def test_an_unknown_suffix_lists_the_known_ones(scratch, tmp_path):
    with pytest.raises(InputError, match=r"scan\.doc.*'\.doc'.*\.ply, \.pcd, \.xyz.*\.bin"):
        dw.read(scratch("scan.doc", b"x"))
    with pytest.raises(InputError, match=r"unknown suffix ''"):
        dw.read(scratch("scan", b"x"))
    with pytest.raises(InputError, match=r"scan\.xyz.*'\.xyz'; known are \.ply, \.npz"):
        CLOUD.save(tmp_path / "scan.xyz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["Scan.PLY", "Scan.NPZ"])
def test_letter_case_of_the_suffix_and_a_path_as_text(tmp_path, name):
    CLOUD.save(str(tmp_path / name))
    cloud = dw.read(str(tmp_path / name))
    np.testing.assert_array_equal(cloud.points_world, CLOUD.points_world)
    np.testing.assert_array_equal(cloud.attributes["color"], CLOUD.attributes["color"])


@pytest.mark.parametrize("offset", [(1.0, 2.0), (1.0, 2.0, float("nan")), (0.0, float("inf"), 0.0)])
def test_an_offset_that_is_none(scratch, offset):
    with pytest.raises(InputError, match="offset must be three finite numbers"):
        dw.read(scratch("one.xyz", "1 2 3\n"), offset=offset)


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_a_write_that_fails_leaves_the_older_file(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(b"older")

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("depthwarp.io.ply.np.empty", full)
    monkeypatch.setattr("depthwarp.io.npz.npy.write_array", full)
    with pytest.raises(InputError, match=f"{path.name}: No space left"):
        CLOUD.save(path)
    assert path.read_bytes() == b"older"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".ply", ".npz"])
def test_an_output_that_cannot_be_written(tmp_path, suffix):
    with pytest.raises(InputError, match="folder .*absent does not exist"):
        CLOUD.save(tmp_path / "absent" / f"cloud{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(InputError, match="it is a folder"):
        CLOUD.save(tmp_path / f"folder{suffix}")


def test_a_cloud_that_does_not_fit_the_memory(scratch, monkeypatch):
    def read(_path, _offset):
        raise MemoryError

    monkeypatch.setitem(dw.io.READERS, ".xyz", read)
    with pytest.raises(CapacityError, match=r"large\.xyz: .*GB of points do not fit the memory"):
        dw.read(scratch("large.xyz", "1 2 3\n"))


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".pts", ".bin"])
def test_more_points_than_a_cloud_can_hold(scratch, suffix, monkeypatch):
    monkeypatch.setattr("depthwarp.io.rows.MAX_POINTS", 1)
    header = {
        ".ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\n1 2 3\n4 5 6\n",
        ".pcd": b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nDATA ascii\n1 2 3\n4 5 6\n",
        ".pts": b"2\n1 2 3\n4 5 6\n",
        ".bin": b"\0" * 32,
    }
    with pytest.raises(InputError, match="2 points, at most 1 fit one cloud"):
        dw.read(scratch(f"many{suffix}", header[suffix]))


def test_importing_the_readers_imports_neither_warp_nor_opencv():
    code = (
        "import sys, depthwarp.io; "
        "assert not {'warp', 'cv2', 'matplotlib'} & sys.modules.keys(), 'heavy import'"
    )
    path = [p for p in sys.path if p]
    subprocess.run([sys.executable, "-c", f"import sys; sys.path[:0] = {path}; {code}"], check=True)


def _valid_files(folder):
    """One valid file of every format and encoding, by suffix."""
    rows = "".join(f"{k} {k + 1} {k + 2} {k * 20}\n" for k in range(8))
    header = "SIZE 4 4 4 4\nTYPE F F F F\nWIDTH 8\nHEIGHT 1\n"
    values = np.arange(32, dtype="<f4").reshape(8, 4)
    compressed = b"".join(b"\x1f" + values.T.tobytes()[k : k + 32] for k in range(0, 128, 32))
    sizes = np.array([len(compressed), 128], "<u4").tobytes()
    ply = "element face 2\nproperty list uchar int v\nelement vertex 8\n" + "".join(
        f"property float {name}\n" for name in ("x", "y", "z", "intensity")
    )
    faces = b"\x01\x05\0\0\0" + b"\x02\x01\0\0\0\x02\0\0\0"
    contents = {
        "a.ply": f"ply\nformat ascii 1.0\n{ply}end_header\n1 5\n2 1 2\n{rows}".encode(),
        "b.ply": f"ply\nformat binary_little_endian 1.0\n{ply}end_header\n".encode()
        + faces
        + values.tobytes(),
        "a.pcd": f"FIELDS x y z rgb\n{header}DATA ascii\n{rows}".encode(),
        "b.pcd": f"FIELDS x y z rgb\n{header}DATA binary\n".encode() + values.tobytes(),
        "c.pcd": f"FIELDS x y z rgb\n{header}DATA binary_compressed\n".encode()
        + sizes
        + compressed,
        "a.xyz": rows.encode(),
        "a.csv": b"x,y,z,ring\n" + rows.replace(" ", ",").encode(),
        "a.pts": b"8\n" + rows.encode(),
        "a.bin": values.tobytes(),
    }
    CLOUD.save(folder / "cloud.npz")
    return contents | {"a.npz": (folder / "cloud.npz").read_bytes()}


@pytest.fixture(scope="module")
def valid_files(tmp_path_factory):
    return _valid_files(tmp_path_factory.mktemp("valid"))


def test_the_valid_files_are_valid(scratch, valid_files):
    for name, content in valid_files.items():
        assert len(dw.read(scratch(name, content))) == (4 if name == "a.npz" else 8), name


DAMAGE = st.one_of(
    st.tuples(st.just("cut"), st.floats(0, 1), st.just(b"")),
    st.tuples(st.just("replace"), st.floats(0, 1), st.binary(min_size=1, max_size=4)),
    st.tuples(
        st.just("replace"),
        st.floats(0, 0.5),
        st.sampled_from([b"9", b"-", b"\n", b" ", b"\xff\xff\xff\xff", b"99999999999", b"nan "]),
    ),
    st.tuples(st.just("insert"), st.floats(0, 1), st.binary(min_size=1, max_size=9)),
)


@settings(max_examples=400, deadline=None)
@given(data=st.data(), damages=st.lists(DAMAGE, min_size=1, max_size=3))
def test_a_damaged_file_gives_a_cloud_or_a_clear_error(scratch, valid_files, data, damages):
    """Whatever is cut, overwritten or inserted: never a crash, never another kind of error."""
    name = data.draw(st.sampled_from(sorted(valid_files)))
    content = valid_files[name]
    for kind, where, new in damages:
        at = int(where * len(content))
        end = {"cut": len(content), "replace": at + len(new), "insert": at}[kind]
        content = content[:at] + new + content[end:]
    try:
        cloud = dw.read(scratch("damaged" + name, content))
    except DepthwarpError as error:
        assert isinstance(error, InputError)
        assert "damaged" + name in str(error)
    else:
        assert cloud.points_world.shape == (len(cloud), 3)
