"""PCD: three encodings, packed colours, padding, organised clouds, damaged LZF data."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError
from depthwarp_kernels import lzf

ENCODINGS = ["ascii", "binary", "binary_compressed"]
CODES = {"F4": "f", "F8": "d", "I1": "b", "I2": "h", "I4": "i", "I8": "q",
         "U1": "B", "U2": "H", "U4": "I", "U8": "Q"}  # fmt: skip


def lzf_literal(data):
    """LZF without any repetition: runs of up to 32 bytes behind their length - 1."""
    runs = (data[k : k + 32] for k in range(0, len(data), 32))
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def lzf_repeating(data):
    """LZF with back references, greedy, including ones that overlap what they write."""
    out, pending, last, k = b"", b"", {}, 0
    while k < len(data):
        back = last.get(data[k : k + 3])
        last[data[k : k + 3]] = k
        if back is None or k - back > 8192 or k + 3 > len(data):
            pending += data[k : k + 1]
            k += 1
            continue
        length = 3
        while length < 264 and k + length < len(data) and data[back + length] == data[k + length]:
            length += 1
        out += lzf_literal(pending)
        pending = b""
        distance = k - back - 1
        if length - 2 < 7:
            out += bytes([(length - 2) << 5 | distance >> 8, distance & 255])
        else:
            out += bytes([7 << 5 | distance >> 8, length - 9, distance & 255])
        k += length
    return out + lzf_literal(pending)


def pcd(encoding, fields, rows, *, compress=lzf_repeating, width=None, height=1, header=None):
    """Bytes of a PCD: fields are (name, type and size, count), rows hold the values in order."""
    width = len(rows) // height if width is None else width
    lines = header or [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        "FIELDS " + " ".join(name for name, _, _ in fields),
        "SIZE " + " ".join(kind[1:] for _, kind, _ in fields),
        "TYPE " + " ".join(kind[0] for _, kind, _ in fields),
        "COUNT " + " ".join(str(count) for _, _, count in fields),
        f"WIDTH {width}",
        f"HEIGHT {height}",
        "VIEWPOINT 1 2 3 0 1 0 0",
        f"POINTS {width * height}",
        f"DATA {encoding}",
    ]
    if encoding == "ascii":
        body = "".join(" ".join(repr(v) for v in row) + "\n" for row in rows).encode()
    elif encoding == "binary":
        row_format = "<" + "".join(CODES[kind] * count for _, kind, count in fields)
        body = b"".join(struct.pack(row_format, *row) for row in rows)
    else:
        body, first = b"", 0
        for _, kind, count in fields:
            values = [v for row in rows for v in row[first : first + count]]
            body += struct.pack(f"<{len(values)}{CODES[kind]}", *values)
            first += count
        packed = compress(body)
        body = struct.pack("<II", len(packed), len(body)) + packed
    return ("\n".join(lines) + "\n").encode() + body


XYZ = [("x", "F4", 1), ("y", "F4", 1), ("z", "F4", 1)]
ROWS = [(0.5, -1.25, 3.0), (4.0, 5.5, -6.0), (7.75, 8.0, 9.0)]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("kind", CODES)
def test_every_type_in_every_encoding(scratch, encoding, kind):
    values = [0.5, -2.25, 1e10] if kind[0] == "F" else [1, 2, 100]
    if kind[1] == "8" and kind[0] != "F":
        values = [1, 2, 1_700_000_000_123_456_789]  # nanoseconds: float64 would round them
    fields = [*XYZ, ("label", kind, 1)]
    rows = [(*row, value) for row, value in zip(ROWS, values, strict=True)]
    cloud = dw.read(scratch("types.pcd", pcd(encoding, fields, rows)))
    np.testing.assert_array_equal(cloud.points_world, np.array(ROWS, np.float32))
    label = cloud.attributes["label"]
    assert label.dtype == np.dtype(kind.lower()) and label.dtype.isnative
    np.testing.assert_array_equal(label, np.array(values, kind.lower()))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_standard_names_and_fields_of_several_values(scratch, encoding):
    fields = [
        ("intensity", "F4", 1), *XYZ, ("fpfh", "F4", 3), ("normal_x", "F4", 1),
        ("normal_y", "F4", 1), ("normal_z", "F4", 1), ("ring", "U2", 1), ("t", "U4", 1),
        ("curvature", "F4", 1),
    ]  # fmt: skip
    rows = [(0.5, 1.0, 2.0, 3.0, 7.0, 8.0, 9.0, 0.0, 0.0, 1.0, 31, 4_000_000_000, 0.25)] * 2
    attributes = dw.read(scratch("names.pcd", pcd(encoding, fields, rows))).attributes
    assert set(attributes) == {"intensity", "fpfh", "normals", "ring", "time", "curvature"}
    np.testing.assert_array_equal(attributes["fpfh"], [[7, 8, 9]] * 2)
    np.testing.assert_array_equal(attributes["normals"], [[0, 0, 1]] * 2)
    assert attributes["time"].dtype == np.uint32 and attributes["time"][0] == 4_000_000_000
    assert attributes["ring"].dtype == np.uint16


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_padding_is_skipped(scratch, encoding):
    fields = [XYZ[0], ("_", "U1", 3), XYZ[1], XYZ[2], ("_", "F4", 1), ("ring", "U1", 1)]
    rows = [(x, 1, 2, 3, y, z, 9.0, 5) for x, y, z in ROWS]
    cloud = dw.read(scratch("padding.pcd", pcd(encoding, fields, rows)))
    np.testing.assert_array_equal(cloud.points_world, np.array(ROWS, np.float32))
    assert list(cloud.attributes) == ["ring"]
    np.testing.assert_array_equal(cloud.attributes["ring"], [5, 5, 5])


def test_padding_that_a_compressed_body_leaves_out(scratch):
    """Some writers declare padding and then leave it out of the compressed columns."""
    without = pcd("binary_compressed", [*XYZ, ("ring", "U1", 1)], [(*row, 5) for row in ROWS])
    content = (
        without.replace(b"x y z ring", b"x _ y z ring")
        .replace(b"SIZE 4 4 4 1", b"SIZE 4 1 4 4 1")
        .replace(b"TYPE F F F U", b"TYPE F U F F U")
        .replace(b"COUNT 1 1 1 1", b"COUNT 1 4 1 1 1")
    )
    cloud = dw.read(scratch("left_out.pcd", content))
    np.testing.assert_array_equal(cloud.points_world, np.array(ROWS, np.float32))
    np.testing.assert_array_equal(cloud.attributes["ring"], [5, 5, 5])


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("kind", ["F4", "U4", "I4"])
@pytest.mark.parametrize("name", ["rgb", "rgba"])
def test_packed_colors(scratch, encoding, kind, name):
    bits = [0x12345678, 0x00FF8001]  # alpha red green blue; the second is a denormal float
    values = [struct.unpack("<" + CODES[kind], struct.pack("<I", b))[0] for b in bits]
    rows = [(*row, value) for row, value in zip(ROWS, values, strict=False)]
    attributes = dw.read(
        scratch("rgb.pcd", pcd(encoding, [*XYZ, (name, kind, 1)], rows))
    ).attributes
    assert attributes["color"].dtype == np.uint8
    np.testing.assert_array_equal(attributes["color"], [[0x34, 0x56, 0x78], [0xFF, 0x80, 0x01]])
    if name == "rgba":
        np.testing.assert_array_equal(attributes["alpha"], np.array([0x12, 0], np.uint8))
    assert set(attributes) == ({"color", "alpha"} if name == "rgba" else {"color"})


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_an_organised_cloud_keeps_its_order_and_its_holes(scratch, encoding):
    nan = float("nan")
    rows = [ROWS[0], (nan, nan, nan), ROWS[1], (nan, nan, nan), ROWS[2], ROWS[0]]
    cloud = dw.read(scratch("organised.pcd", pcd(encoding, XYZ, rows, height=2)))
    np.testing.assert_array_equal(cloud.points_world, np.array(rows, np.float32))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("count", [0, 1])
def test_zero_and_one_point(scratch, encoding, count):
    fields = [*XYZ, ("fpfh", "F4", 2)]
    rows = [(*ROWS[0], 1.0, 2.0)][:count]
    cloud = dw.read(scratch("few.pcd", pcd(encoding, fields, rows)))
    assert cloud.points_world.shape == (count, 3)
    assert cloud.attributes["fpfh"].shape == (count, 2)


def test_old_versions(scratch):
    header = ["VERSION .5", "COLUMNS x y z", "SIZE 4 4 4", "TYPE F F F", "WIDTH 3", "DATA ascii"]
    cloud = dw.read(scratch("old.pcd", pcd("ascii", XYZ, ROWS, header=header)))
    np.testing.assert_array_equal(cloud.points_world, ROWS)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_map_coordinates_need_an_offset(scratch, encoding):
    fields = [(axis, "F8", 1) for axis in "xyz"]
    path = scratch("utm.pcd", pcd(encoding, fields, [(500_000.123, 5_400_000.456, 1.5)]))
    with pytest.raises(InputError, match=r"utm\.pcd.*offset"):
        dw.read(path)
    cloud = dw.read(path, offset=(5e5, 5.4e6, 0))
    np.testing.assert_allclose(cloud.points_world, [[0.123, 0.456, 1.5]], atol=1e-7)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("claimed", [10**12, 10**30])
def test_a_header_that_claims_too_many_points(scratch, encoding, claimed):
    content = pcd(encoding, XYZ, ROWS).replace(b"WIDTH 3", b"WIDTH %d" % claimed)
    content = content.replace(b"POINTS 3", b"POINTS %d" % claimed)
    with pytest.raises(FileFormatError, match=rf"claims {claimed} points.* 3[ ;]"):
        dw.read(scratch("huge.pcd", content))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_truncated_data(scratch, encoding):
    content = pcd(encoding, XYZ, ROWS)
    cut = content[: content.rindex(b"7.75")] if encoding == "ascii" else content[:-1]
    with pytest.raises(FileFormatError, match="claims 3 points.*cut short.*copy the file again"):
        dw.read(scratch("cut.pcd", cut))


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_more_points_than_claimed_are_not_dropped_silently(scratch, encoding):
    content = pcd(encoding, XYZ, ROWS)
    fewer = content.replace(b"WIDTH 3", b"WIDTH 2").replace(b"POINTS 3", b"POINTS 2")
    with pytest.raises(FileFormatError, match="claims 2 points, the file holds (3|more)"):
        dw.read(scratch("more.pcd", fewer))


@pytest.mark.parametrize("encoding", ["binary", "binary_compressed"])
def test_zeros_after_the_data_are_padding(scratch, encoding):
    assert len(dw.read(scratch("pad.pcd", pcd(encoding, XYZ, ROWS) + b"\0" * 4096))) == 3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"# .PCD", b"PCD", "line 1: not a PCD header line"),
        (b"VERSION", b"VERSION 0.7\nVERSION", "line 3: not a PCD header line"),
        (b"DATA ascii\n", b"", "line 11: not a PCD header line|no line 'DATA"),
        (b"DATA ascii", b"DATA zip", "DATA must be ascii, binary or binary_compressed, got 'zip'"),
        (b"DATA ascii", b"DATA", "DATA must be"),
        (b"FIELDS x y z", b"", "no line FIELDS"),
        (b"FIELDS x y z", b"FIELDS x y", "2, 3, 3 and 3 entries"),
        (b"FIELDS x y z", b"FIELDS x y y", "'y' is declared twice"),
        (b"FIELDS x y z", b"FIELDS x y w", "no field z; it has x, y, w"),
        (b"SIZE 4 4 4", b"SIZE 4 4 3", "TYPE and SIZE are F3"),
        (b"TYPE F F F", b"TYPE F F X", "TYPE and SIZE are X4"),
        (b"COUNT 1 1 1", b"COUNT 1 1 0", "COUNT must be 1 to"),
        (b"COUNT 1 1 1", b"COUNT 1 1 99999999999", "COUNT must be 1 to"),
        (b"COUNT 1 1 1", b"COUNT 60000 1 1", "a point takes more than"),
        (b"COUNT 1 1 1", b"COUNT 1 1 2", "line 12: 3 values, expected 4"),
        (b"WIDTH 3", b"", "no line WIDTH"),
        (b"WIDTH 3", b"WIDTH", "line 7: WIDTH must be one number"),
        (b"WIDTH 3", b"WIDTH -3", "line 7: expected a whole number"),
        (b"HEIGHT 1", b"HEIGHT 2", "POINTS is 3, but WIDTH x HEIGHT is 6"),
        (b"-1.25", b"east", "line 12: could not convert string 'east' to float32"),
    ],
)
def test_bad_headers_and_rows(scratch, old, new, message):
    content = pcd("ascii", XYZ, ROWS)
    assert old in content
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("bad.pcd", content.replace(old, new, 1)))


def test_coordinates_of_several_values(scratch):
    path = scratch("vector.pcd", pcd("ascii", [XYZ[0], XYZ[1], ("z", "F4", 2)], [(1, 2, 3, 4)]))
    with pytest.raises(FileFormatError, match="no columns x, y, z with one number a point"):
        dw.read(path)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"", "claims 3 points, the file holds 0"),
        (b"\1\0\0", "claims 3 points, the file holds 0"),
        (struct.pack("<II", 5, 37) + b"12345", r"holds 3 \(37 bytes\)"),
        (struct.pack("<II", 500, 36) + b"12345", "500 compressed bytes, the file holds 5"),
        (struct.pack("<II", 0, 36), "0 compressed bytes cannot hold their 36"),
        (struct.pack("<II", 2, 36) + b"\x20\x00", "damaged: 0 of 36 bytes"),  # before the start
        (struct.pack("<II", 2, 36) + b"\x1fa", "damaged: 0 of 36 bytes"),  # literals are missing
        (struct.pack("<II", 3, 36) + b"\0a\xe0", "damaged: 1 of 36 bytes"),  # a length is missing
        (struct.pack("<II", 3, 36) + b"\0a\x20", "damaged: 1 of 36 bytes"),  # a distance is missing
        (struct.pack("<II", 5, 36) + b"\0a\xe0\xff\0", "damaged: 1 of 36"),  # 264 bytes do not fit
        (struct.pack("<II", 35, 36) + b"\x1f" + b"a" * 32 + b"\0a", "damaged: 33 of 36"),
    ],
)
def test_damaged_compressed_bodies(scratch, body, message):
    content = pcd("binary_compressed", XYZ, ROWS)
    header = content[: content.index(b"compressed\n") + len(b"compressed\n")]
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("damaged.pcd", header + body))


def decompress(compressed, size):
    """Run the kernel between guard bytes; returns status, bytes written, data, and the guards."""
    source = np.full(len(compressed) + 16, 0x1F, np.uint8)
    source[8 : 8 + len(compressed)] = np.frombuffer(compressed, np.uint8)
    target = np.full(size + 600, 0xA5, np.uint8)
    status, written = np.zeros(1, np.int32), np.zeros(1, np.int32)
    arrays = (source[8 : 8 + len(compressed)], target[300 : 300 + size], status, written)
    shared = [
        wp.array(a, dtype=wp.dtype_from_numpy(a.dtype), device="cpu", copy=False) for a in arrays
    ]
    wp.launch(lzf.lzf_decompress, dim=1, inputs=shared[:1], outputs=shared[1:], device="cpu")
    guards = np.concatenate([target[:300], target[300 + size :]])
    return int(status[0]), int(written[0]), target[300 : 300 + size].tobytes(), guards


# Few different bytes and pieces that repeat, so that back references happen.
COMPRESSIBLE = st.lists(
    st.one_of(st.binary(min_size=1, max_size=50), st.sampled_from([b"a" * 300, b"abc" * 100])),
    max_size=8,
).map(b"".join)


@given(data=COMPRESSIBLE, compress=st.sampled_from([lzf_literal, lzf_repeating]))
def test_lzf_gives_back_what_was_compressed(data, compress):
    status, written, result, guards = decompress(compress(data), len(data))
    assert (status, written, result) == (lzf.LZF_OK, len(data), data)
    assert np.all(guards == 0xA5)


def test_the_tests_compressor_repeats_overlapping_and_far_pieces():
    data = b"x" * 1000 + bytes(range(256)) * 40
    packed = lzf_repeating(data)
    assert len(packed) < len(data) / 10
    assert decompress(packed, len(data))[2] == data


@settings(max_examples=300)
@given(compressed=st.binary(max_size=200), size=st.integers(0, 300))
def test_lzf_never_writes_outside_whatever_it_is_given(compressed, size):
    status, written, _, guards = decompress(compressed, size)
    assert np.all(guards == 0xA5)
    assert 0 <= written <= size
    if status == lzf.LZF_OK and written == size and size:
        assert compressed  # something must have said what to write


@pytest.mark.parametrize(
    ("compressed", "size", "status"),
    [
        (b"\x05abc", 100, lzf.LZF_INPUT_ENDS),
        (b"\x03abc", 100, lzf.LZF_INPUT_ENDS),
        (b"\x02abc\xe0", 100, lzf.LZF_INPUT_ENDS),
        (b"\x02abc\xe0\x05", 100, lzf.LZF_INPUT_ENDS),
        (b"\x02abc", 2, lzf.LZF_OUTPUT_FULL),
        (b"\x02abc\x20\x00", 5, lzf.LZF_OUTPUT_FULL),
        (b"\x02abc\x20\x03", 100, lzf.LZF_REFERS_BEFORE_START),
        (b"\x02abc\x3f\xff", 100, lzf.LZF_REFERS_BEFORE_START),
    ],
)
def test_lzf_says_what_is_wrong(compressed, size, status):
    assert decompress(compressed, size)[0] == status


@pytest.mark.parametrize(
    ("name", "count", "finite", "extent"),
    [
        ("indoor/room_scan1.pcd", 112_586, 112_586, (29.25, 14.47, 3.06)),
        ("kinect_organised/office1.pcd", 307_200, 254_456, (4.15, 3.78, 3.53)),
        ("kinect_organised/capture0001.pcd", 307_200, 249_647, (2.95, 1.98, 1.65)),
    ],
)
def test_real_scans(real_file, name, count, finite, extent):
    cloud = dw.read(real_file(name))
    assert len(cloud) == count
    points = cloud.points_world[np.isfinite(cloud.points_world).all(axis=1)]
    assert len(points) == finite
    np.testing.assert_allclose(np.ptp(points, axis=0), extent, atol=0.006)


def test_a_real_kinect_frame_projects_onto_its_own_pixel_grid(real_file):
    """The order is the image's: x / z grows by the same step from column to column."""
    cloud = dw.read(real_file("kinect_organised/office1.pcd"))
    x, _, z = cloud.points_world.reshape(480, 640, 3).transpose(2, 0, 1)
    column = x / z * 525.0
    step = np.diff(column, axis=1)
    assert np.nanmedian(step) == pytest.approx(1.0, abs=0.01)
    assert cloud.attributes["color"].shape == (307_200, 3)
    assert cloud.attributes["color"].std() > 20  # a picture, not noise around one value
