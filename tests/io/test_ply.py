"""PLY: every type and byte order, other elements around the vertices, headers that lie."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}

# The test's own table: name in the file -> (struct code, numpy type).
TYPES = {
    "char": ("b", "i1"), "uchar": ("B", "u1"), "short": ("h", "i2"), "ushort": ("H", "u2"),
    "int": ("i", "i4"), "uint": ("I", "u4"), "float": ("f", "f4"), "double": ("d", "f8"),
    "int8": ("b", "i1"), "uint8": ("B", "u1"), "int16": ("h", "i2"), "uint16": ("H", "u2"),
    "int32": ("i", "i4"), "uint32": ("I", "u4"), "float32": ("f", "f4"), "float64": ("d", "f8"),
}  # fmt: skip


def ply(format_name, *elements, comment="made by hand"):
    """Bytes of a PLY: elements are (name, [(type or (length type, type), property)], rows)."""
    header = f"ply\nformat {format_name} 1.0\ncomment {comment}\nobj_info x\n"
    body = b""
    order = FORMATS[format_name]
    for name, properties, rows in elements:
        header += f"element {name} {len(rows)}\n"
        for kind, prop in properties:
            spelled = kind if isinstance(kind, str) else f"list {kind[0]} {kind[1]}"
            header += f"property {spelled} {prop}\n"
        for row in rows:
            words = []
            for (kind, _), value in zip(properties, row, strict=True):
                if isinstance(kind, str):
                    words.append((kind, value))
                else:
                    words.append((kind[0], len(value)))
                    words += [(kind[1], item) for item in value]
            if order:
                body += b"".join(struct.pack(order + TYPES[kind][0], v) for kind, v in words)
            else:
                body += (" ".join(repr(v) for _, v in words) + "\n").encode()
    return (header + "end_header\n").encode() + body


XYZ = [("float", "x"), ("float", "y"), ("float", "z")]
ROWS = [(0.5, -1.25, 3.0), (4.0, 5.5, -6.0), (7.75, 8.0, 9.0)]
FACES = ("face", [(("uchar", "int"), "vertex_indices")], [((0, 1, 2),), ((0, 2),), ((),)])


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("kind", TYPES)
def test_every_type_in_every_format(scratch, format_name, kind):
    code, numpy_type = TYPES[kind]
    values = [1, 2, 100] if code in "bB" else [1, 300, 32000]
    if code in "fd":
        values = [0.5, -2.25, 1e10]
    rows = [(*row, value) for row, value in zip(ROWS, values, strict=True)]
    path = scratch("types.ply", ply(format_name, ("vertex", [*XYZ, (kind, "label")], rows)))
    cloud = dw.read(path)
    np.testing.assert_array_equal(cloud.points_world, np.array(ROWS, np.float32))
    label = cloud.attributes["label"]
    assert label.dtype == np.dtype(numpy_type)
    assert label.dtype.isnative and label.flags.c_contiguous and label.flags.writeable
    np.testing.assert_array_equal(label, np.array(values, numpy_type))


@pytest.mark.parametrize("format_name", FORMATS)
def test_standard_names_become_color_and_normals(scratch, format_name):
    properties = [
        ("uchar", "red"), ("double", "x"), ("double", "y"), ("double", "z"), ("uchar", "green"),
        ("float", "nx"), ("float", "ny"), ("float", "nz"), ("uchar", "blue"), ("uchar", "alpha"),
        ("ushort", "ring"), ("double", "timestamp"), ("float", "scalar_Intensity"),
    ]  # fmt: skip
    row = (1, 10.5, 20.5, 30.5, 2, 0.0, -1.0, 0.5, 255, 7, 65535, 1.7e9 + 0.125, 0.25)
    cloud = dw.read(scratch("names.ply", ply(format_name, ("vertex", properties, [row]))))
    np.testing.assert_array_equal(cloud.points_world, [[10.5, 20.5, 30.5]])
    expected = {
        "color": np.array([[1, 2, 255]], np.uint8),
        "normals": np.array([[0.0, -1.0, 0.5]], np.float32),
        "alpha": np.array([7], np.uint8),
        "ring": np.array([65535], np.uint16),
        "time": np.array([1.7e9 + 0.125], np.float64),
        "intensity": np.array([0.25], np.float32),
    }
    assert set(cloud.attributes) == set(expected)
    for name, values in expected.items():
        assert cloud.attributes[name].dtype == values.dtype, name
        np.testing.assert_array_equal(cloud.attributes[name], values, err_msg=name)


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize(
    ("kind", "values", "dtype"),
    [
        ("float", (0.0, 0.5, 1.0), np.float32),
        ("ushort", (0, 7, 255), np.uint16),  # a dark 16-bit colour stays 16 bit
        ("ushort", (0, 7, 65535), np.uint16),
        ("int", (0, 7, 255), np.uint8),
        ("int", (0, 7, 256), np.uint16),
        ("int", (-1, 7, 255), np.int32),
    ],
)
def test_color_keeps_its_values(scratch, format_name, kind, values, dtype):
    properties = [*XYZ, (kind, "red"), (kind, "green"), (kind, "blue")]
    path = scratch("color.ply", ply(format_name, ("vertex", properties, [(*ROWS[0], *values)])))
    color = dw.read(path).attributes["color"]
    assert color.dtype == dtype
    np.testing.assert_array_equal(color, [values])


@pytest.mark.parametrize("format_name", FORMATS)
def test_other_elements_before_and_after_the_vertices(scratch, format_name):
    scanner = ("scanner", [("double", "power"), ("uchar", "id")], [(1.5, 3), (2.5, 4)])
    signed = ("strip", [("short", "n"), (("int", "short"), "s")], [(1, (5, 6, 7)), (2, ())])
    vertices = ("vertex", XYZ, ROWS)
    content = ply(format_name, scanner, FACES, signed, vertices, FACES, scanner)
    cloud = dw.read(scratch("elements.ply", content))
    np.testing.assert_array_equal(cloud.points_world, np.array(ROWS, np.float32))


def test_a_comment_may_hold_end_header_and_lines_may_end_in_crlf(scratch):
    content = ply("binary_little_endian", ("vertex", XYZ, ROWS), comment="end_header")
    header, body = content.split(b"\nend_header\n")
    content = header.replace(b"\n", b"\r\n") + b"\r\nend_header\r\n" + body
    assert len(dw.read(scratch("crlf.ply", content))) == 3
    text = ply("ascii", ("vertex", XYZ, ROWS)).replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(dw.read(scratch("crlf.ply", text)).points_world, ROWS)


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("count", [0, 1])
def test_zero_and_one_point(scratch, format_name, count):
    properties = [*XYZ, ("uchar", "red"), ("uchar", "green"), ("uchar", "blue")]
    rows = [(*ROWS[0], 1, 2, 3)][:count]
    cloud = dw.read(scratch("few.ply", ply(format_name, ("vertex", properties, rows))))
    assert cloud.points_world.shape == (count, 3)
    assert cloud.attributes["color"].shape == (count, 3)
    assert cloud.attributes["color"].dtype == np.uint8


@pytest.mark.parametrize("format_name", FORMATS)
def test_points_that_are_not_finite_are_kept_in_order(scratch, format_name):
    nan, inf = float("nan"), float("inf")
    rows = [ROWS[0], (nan, 1.0, nan), (inf, -inf, 0.0), ROWS[1]]
    cloud = dw.read(scratch("nan.ply", ply(format_name, ("vertex", XYZ, rows))))
    np.testing.assert_array_equal(cloud.points_world, np.array(rows, np.float32))


@pytest.mark.parametrize("kind", ["float", "double"])
def test_signalling_nan_and_values_beyond_float32_raise_no_warning(scratch, kind):
    names = ("x", "y", "z", "nx", "ny", "nz")
    empty = ply("binary_little_endian", ("vertex", [(kind, name) for name in names], []))
    nan, huge = (
        (b"\1\0\x80\x7f", 3e38) if kind == "float" else (b"\1" + b"\0" * 5 + b"\xf0\x7f", 1e300)
    )
    body = nan + struct.pack("<5" + TYPES[kind][0], 2.0, 3.0, huge, 0.0, 1.0)
    path = scratch("snan.ply", empty.replace(b"vertex 0", b"vertex 1") + body)
    for offset in (None, (1.0, 1.0, 1.0)):
        cloud = dw.read(path, offset=offset)
        shift = 0.0 if offset is None else 1.0
        np.testing.assert_array_equal(cloud.points_world, [[np.nan, 2 - shift, 3 - shift]])
        with np.errstate(over="ignore"):
            np.testing.assert_array_equal(cloud.attributes["normals"][:, 0], np.float32(huge))


@pytest.mark.parametrize("format_name", FORMATS)
def test_map_coordinates_need_an_offset(scratch, format_name):
    properties = [("double", "x"), ("double", "y"), ("double", "z")]
    rows = [(500_000.123, 5_400_000.456, 100.789), (500_001.123, 5_400_002.456, 101.789)]
    path = scratch("utm.ply", ply(format_name, ("vertex", properties, rows)))
    with pytest.raises(InputError, match=r"utm\.ply.*offset"):
        dw.read(path)
    offset = (500_000.0, 5_400_000.0, 100.0)
    expected = (np.array(rows) - offset).astype(np.float32)
    np.testing.assert_array_equal(dw.read(path, offset=offset).points_world, expected)


def test_an_offset_is_subtracted_in_float64_from_float32_coordinates_too(scratch):
    path = scratch("near.ply", ply("binary_little_endian", ("vertex", XYZ, [(0.1, 0.2, 0.3)])))
    exact = np.array([[0.1, 0.2, 0.3]], np.float32).astype(np.float64) - (1e-9, 1e3, -1e3)
    cloud = dw.read(path, offset=(1e-9, 1e3, -1e3))
    np.testing.assert_array_equal(cloud.points_world, exact.astype(np.float32))


@pytest.mark.parametrize("format_name", FORMATS)
def test_truncated_data_says_how_many_points_are_there(scratch, format_name):
    content = ply(format_name, ("vertex", XYZ, ROWS))
    cut = content[: content.rindex(b"7.75")] if format_name == "ascii" else content[:-1]
    message = r"cut\.ply: the header claims 3 points, the file holds 2;.*copy the file again"
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("cut.ply", cut))


def test_text_cut_inside_a_row_names_the_line(scratch):
    content = ply("ascii", ("vertex", XYZ, ROWS))
    with pytest.raises(FileFormatError, match=r"line 12: 1 values, expected 3.*copy the file"):
        dw.read(scratch("cut.ply", content[: content.rindex(b" 8.0")]))


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("claimed", [10**12, 10**30])
def test_a_header_that_claims_too_many_points(scratch, format_name, claimed):
    content = ply(format_name, ("vertex", XYZ, ROWS))
    content = content.replace(b"vertex 3", b"vertex %d" % claimed)
    with pytest.raises(FileFormatError, match=f"claims {claimed} points, the file holds 3"):
        dw.read(scratch("huge.ply", content))


@pytest.mark.parametrize("format_name", FORMATS)
@pytest.mark.parametrize("claimed", [10**12, 10**30])
def test_elements_before_the_vertices_that_claim_too_much(scratch, format_name, claimed):
    content = ply(format_name, FACES, ("vertex", XYZ, ROWS))
    content = content.replace(b"face 3", b"face %d" % claimed)
    with pytest.raises(FileFormatError, match=f"claims {claimed} .*copy the file again"):
        dw.read(scratch("faces.ply", content))


@pytest.mark.parametrize("format_name", FORMATS)
def test_more_points_than_claimed_are_not_dropped_silently(scratch, format_name):
    content = ply(format_name, ("vertex", XYZ, ROWS))
    path = scratch("more.ply", content.replace(b"vertex 3", b"vertex 2"))
    with pytest.raises(FileFormatError, match="claims 2 points, the file holds (3|more)"):
        dw.read(path)
    assert len(dw.read(scratch("padded.ply", content + b"\n" * 40))) == 3


def test_a_negative_list_length_before_the_vertices(scratch):
    faces = ("face", [(("char", "int"), "v")], [((1,),)])
    content = ply("binary_little_endian", faces, ("vertex", XYZ, ROWS * 100))  # -1 is not 255
    start = content.index(b"end_header\n") + len(b"end_header\n")
    content = content[:start] + b"\xff" + content[start + 1 :]
    with pytest.raises(FileFormatError, match="row 1 runs out of the file"):
        dw.read(scratch("negative.ply", content))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"ply\n", b"plx\n", "first line must begin with 'ply'"),
        (b"end_header\n", b"", "no line 'end_header'"),
        (b"format ascii 1.0\n", b"", "no line 'format"),
        (b"ascii", b"utf8", "line 2: not a PLY header line"),
        (b"1.0", b"2.0", "line 2: not a PLY header line"),
        (b"float x", b"float16 x", "line 6: not a PLY header line"),
        (b"element vertex 3\n", b"", "line 5: not a PLY header line"),
        (b"vertex 3", b"vertex three", "line 5: expected a whole number, got 'three'"),
        (b"vertex 3", b"vertex -3", "line 5: expected a whole number"),
        (b"vertex 3", b"vertices 3", "no element 'vertex'; it has vertices"),
        (b"float z", b"float w", "vertices have no z; they have x, y, w"),
        (b"float y", b"float x", "no y"),
        (b"float z", b"float z\nproperty int z", "'z' is declared twice"),
        (b"float z", b"list uchar float z", "'z' is a list"),
        (b"float z", b"list float float z", "line 8: not a PLY header line"),
        (b"float z", b"float z\nproperty float points", "called 'points'"),
        (b"-1.25", b"east", "line 10: could not convert string 'east' to float32"),
        (b"-1.25 ", b"", "line 10: 2 values, expected 3"),
        (b"5.5", b"5.5 6.5", "line 11: 4 values, expected 3"),
    ],
)
def test_bad_headers_and_rows(scratch, old, new, message):
    content = ply("ascii", ("vertex", XYZ, ROWS))
    assert old in content
    content = content.replace(old, new, 1)
    if b"points" in new:
        content = content.replace(b"3.0\n", b"3.0 1\n").replace(b"-6.0\n", b"-6.0 1\n")
        content = content.replace(b"9.0\n", b"9.0 1\n")
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("bad.ply", content))


@pytest.mark.parametrize("value", ["1.5", "300", "-1"])
def test_text_that_does_not_fit_its_declared_type(scratch, value):
    content = ply("ascii", ("vertex", [*XYZ, ("uchar", "label")], [(*ROWS[0], 7)]))
    with pytest.raises(FileFormatError, match=f"line 11: could not convert string '{value}'"):
        dw.read(scratch("type.ply", content.replace(b" 7\n", f" {value}\n".encode())))


def test_a_header_without_end_is_given_up_after_one_megabyte(scratch):
    with pytest.raises(FileFormatError, match="no line 'end_header'"):
        dw.read(scratch("long.ply", b"ply\n" + b"comment\n" * 200_000 + b"end_header\n"))
    with pytest.raises(FileFormatError, match="no line 'end_header'"):
        dw.read(scratch("long.ply", b"ply\n" + b"\0" * 3_000_000))


@given(
    points=hnp.arrays(np.float32, st.tuples(st.integers(0, 20), st.just(3))),
    dtype=st.sampled_from(["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]),
    data=st.data(),
)
def test_writing_then_reading_keeps_every_bit(scratch, points, dtype, data):
    n = len(points)
    attributes = {
        "color": data.draw(hnp.arrays(st.sampled_from([np.uint8, np.uint16, np.float32]), (n, 3))),
        "normals": data.draw(hnp.arrays(np.float32, (n, 3))),
        "own": data.draw(hnp.arrays(dtype, n)),
    }
    path = scratch("round.ply", b"")
    dw.PointCloud(points, attributes).save(path)
    back = dw.read(path)
    assert back.points_world.tobytes() == points.tobytes()
    assert list(back.attributes) == list(attributes)
    for name, values in attributes.items():
        assert back.attributes[name].dtype == values.dtype
        assert back.attributes[name].tobytes() == values.tobytes()


def test_what_is_written_is_plain_ply(tmp_path):
    """Checked byte by byte, not with the reader under test."""
    cloud = dw.PointCloud(
        np.array([[1, 2, 3]], np.float32),
        {
            "color": np.array([[10, 20, 30]], np.uint8),
            "ring": np.array([5]),  # int64 by default
            "far": np.array([2**32 - 1]),
            "seen": np.array([True]),
            "half": np.array([0.5], np.float16),
            "uv": np.array([[0.5, 1.5]], ">f8"),
        },
    )
    cloud.save(tmp_path / "plain.ply")
    header, body = (tmp_path / "plain.ply").read_bytes().split(b"end_header\n")
    assert header.decode().splitlines() == [
        "ply",
        "format binary_little_endian 1.0",
        "comment x y z in metres",
        "element vertex 1",
        "property float x",
        "property float y",
        "property float z",
        "property uchar red",
        "property uchar green",
        "property uchar blue",
        "property int ring",
        "property uint far",
        "property uchar seen",
        "property float half",
        "property double uv_0",
        "property double uv_1",
    ]
    expected = (1.0, 2.0, 3.0, 10, 20, 30, 5, 2**32 - 1, 1, 0.5, 0.5, 1.5)
    assert struct.unpack("<3f3BiIBfdd", body) == expected
    assert [p.name for p in tmp_path.iterdir()] == ["plain.ply"]


def test_writing_in_blocks_keeps_the_order(tmp_path, monkeypatch):
    monkeypatch.setattr("depthwarp.io.ply.ROWS_A_BLOCK", 7)
    points = np.arange(60, dtype=np.float32).reshape(20, 3)
    dw.PointCloud(points).save(tmp_path / "blocks.ply")
    np.testing.assert_array_equal(dw.read(tmp_path / "blocks.ply").points_world, points)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("time", np.array([2**40])),
        ("time", np.array([1 + 2j])),
        ("name", np.array(["wall"])),
        ("cube", np.zeros((1, 2, 2))),
        ("two words", np.array([1.0])),
        ("größe", np.array([1.0])),
        ("x", np.array([1.0])),
    ],
)
def test_what_ply_cannot_hold_is_refused_and_nothing_is_left(tmp_path, name, values):
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32), {name: values})
    with pytest.raises(InputError, match=f"'{name}'.*save as .npz"):
        cloud.save(tmp_path / "no.ply")
    assert list(tmp_path.iterdir()) == []
