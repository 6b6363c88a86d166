"""Rows of text: separators, comments, column names, PTS counts, lines that are wrong."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

POINTS = np.array([[0.5, -1.25, 3.0], [4.0, 5.5, -6.0]], np.float32)


@pytest.mark.parametrize("suffix", [".xyz", ".txt", ".csv"])
@pytest.mark.parametrize(
    "content",
    [
        "0.5 -1.25 3\n4 5.5 -6\n",
        "0.5 -1.25 3\n4 5.5 -6",
        "0.5\t-1.25\t3\r\n4\t5.5\t-6\r\n",
        "0.5\t-1.25\t3\r4\t5.5\t-6\r",
        "  0.5   -1.25 3  \n\n   \n4 5.5 -6\n\n",
        "0.5,-1.25,3\n4,5.5,-6\n",
        "0.5, -1.25, 3\n4 , 5.5 , -6\n",
        "0.5;-1.25;3\n4;5.5;-6\n",
        "+.5 -125e-2 3.\n4. 55E-1 -6\n",
        "# a scan\n0.5 -1.25 3\n# between\n4 5.5 -6 # behind\n",
        "// a scan\n0.5 -1.25 3\n// between\n4 5.5 -6 // behind\n",
        "x,y,z\n0.5,-1.25,3\n4,5.5,-6\n",
        '"x","y","z"\n0.5,-1.25,3\n4,5.5,-6\n',
        "X Y Z\n0.5 -1.25 3\n4 5.5 -6\n",
        "\ufeffx;y;z\n0.5;-1.25;3\n4;5.5;-6\n",
        "\ufeff0.5 -1.25 3\n4 5.5 -6\n",
        "z,x,y\n3,0.5,-1.25\n-6,4,5.5\n",
    ],
)
def test_the_same_two_points(scratch, suffix, content):
    cloud = dw.read(scratch(f"two{suffix}", content))
    np.testing.assert_array_equal(cloud.points_world, POINTS)
    assert not cloud.attributes


def test_bytes_that_are_not_utf8_in_a_comment(scratch):
    path = scratch("latin.txt", b"# Gr\xf6\xdfe in m\n0.5 -1.25 3\n4 5.5 -6\n")
    np.testing.assert_array_equal(dw.read(path).points_world, POINTS)


def test_one_point_and_points_that_are_not_finite(scratch):
    assert dw.read(scratch("one.xyz", "1 2 3\n")).points_world.shape == (1, 3)
    cloud = dw.read(scratch("nan.xyz", "nan 1 2\n-nan inf -inf\n1 2 3\n"))
    np.testing.assert_array_equal(np.isfinite(cloud.points_world).sum(axis=1), [2, 0, 3])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("1 2 3 0.5\n1 2 3 0.25\n", {"intensity": np.array([0.5, 0.25])}),
        ("1 2 3 7\n1 2 3 -8\n", {"intensity": np.array([7, -8])}),
        ("1 2 3 255 0 7\n1 2 3 0 1 2\n", {"color": np.array([[255, 0, 7], [0, 1, 2]], np.uint8)}),
        (
            "1 2 3 255.0 0.0 7.0\n1 2 3 0.0 1.0 2.0\n",
            {"color": np.array([[255, 0, 7], [0, 1, 2]], np.uint8)},
        ),
        (
            "1 2 3 256 0 7\n1 2 3 0 1 2\n",
            {"normals": np.array([[256, 0, 7], [0, 1, 2]], np.float32)},
        ),
        (
            "1 2 3 0.0 0.0 1.0\n1 2 3 0.0 1.0 0.0\n",
            {"normals": np.array([[0, 0, 1], [0, 1, 0]], np.float32)},
        ),
        (
            "1 2 3 0 0 -1\n1 2 3 0.6 0.8 0\n",
            {"normals": np.array([[0, 0, -1], [0.6, 0.8, 0]], np.float32)},
        ),
        (
            "1 2 3 0.5 8\n1 2 3 0.25 9\n",
            {"column_4": np.array([0.5, 0.25]), "column_5": np.array([8, 9])},
        ),
        (
            "1 2 3 4 5 6 7\n" * 2,
            {f"column_{k}": np.array([k, k]) for k in (4, 5, 6, 7)},
        ),
    ],
)
def test_columns_without_names(scratch, content, expected):
    attributes = dw.read(scratch("columns.xyz", content)).attributes
    assert list(attributes) == list(expected)
    for name, values in expected.items():
        assert attributes[name].dtype == values.dtype, name
        np.testing.assert_array_equal(attributes[name], values)


@pytest.mark.parametrize(
    "names",
    [
        "x,y,z,intensity,r,g,b,nx,ny,nz,ring,t,label",
        "X,Y,Z,Intensity,Red,Green,Blue,Nx,Ny,Nz,Ring,Timestamp,label",
        "//X Y Z intensity r g b normal_x normal_y normal_z ring time label",
        "# x y z intensity red green blue nx ny nz ring time label",
    ],
)
def test_columns_with_names(scratch, names):
    row = "1.5,2.5,3.5,0.5,255,0,7,0.0,0.0,1.0,31,1700000000123456789,4\n"
    row = row if "," in names else row.replace(",", " ")
    attributes = dw.read(scratch("names.csv", f"{names}\n{row}")).attributes
    expected = {
        "color": np.array([[255, 0, 7]], np.uint8),
        "normals": np.array([[0, 0, 1]], np.float32),
        "intensity": np.array([0.5]),
        "ring": np.array([31]),
        "time": np.array([1_700_000_000_123_456_789]),  # float64 would make it ...768
        "label": np.array([4]),
    }
    assert set(attributes) == set(expected)
    for name, values in expected.items():
        assert attributes[name].dtype == values.dtype, name
        np.testing.assert_array_equal(attributes[name], values, err_msg=name)


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        ("0.5,0.25,1.0", np.float32),
        ("1.0,0.0,1.0", np.float32),  # 0..1, though whole
        ("1,0,1", np.uint8),
        ("255.0,0.0,1.0", np.uint8),
        ("256,0,1", np.uint16),
    ],
)
def test_color_keeps_its_values(scratch, values, dtype):
    color = dw.read(scratch("color.csv", f"x,y,z,r,g,b\n1,2,3,{values}\n")).attributes["color"]
    assert color.dtype == dtype
    np.testing.assert_array_equal(color, [[float(v) for v in values.split(",")]])


def test_names_that_cannot_be_grouped_stay_as_they_are(scratch):
    path = scratch("own.csv", "x,y,z,Red,t,timestamp,,Points A\n1,2,3,4.5,5.5,6.5,7.5,8.5\n")
    attributes = dw.read(path).attributes
    expected = {"Red": 4.5, "t": 5.5, "time": 6.5, "column_7": 7.5, "Points A": 8.5}
    assert {name: float(values[0]) for name, values in attributes.items()} == expected


def test_a_comment_that_is_no_list_of_names_is_only_a_comment(scratch):
    path = scratch("comment.txt", "# x y z are in metres\n1 2 3 4.5 5.5\n")
    assert list(dw.read(path).attributes) == ["column_4", "column_5"]


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("2\n0.5 -1.25 3\n4 5.5 -6\n", set()),
        ("2\r\n0.5 -1.25 3\r\n4 5.5 -6", set()),
        ("2\n0.5 -1.25 3 -900\n4 5.5 -6 200\n", {"intensity"}),
        ("2\n0.5 -1.25 3 1 2 3\n4 5.5 -6 4 5 6\n", {"color"}),
        ("2\n0.5 -1.25 3 -900 1 2 3\n4 5.5 -6 200 4 5 6\n", {"intensity", "color"}),
    ],
)
def test_pts(scratch, content, names):
    cloud = dw.read(scratch("scan.pts", content))
    np.testing.assert_array_equal(cloud.points_world, POINTS)
    assert set(cloud.attributes) == names
    if "color" in names:
        assert cloud.attributes["color"].dtype == np.uint8
        np.testing.assert_array_equal(cloud.attributes["color"], [[1, 2, 3], [4, 5, 6]])
    if "intensity" in names:
        np.testing.assert_array_equal(cloud.attributes["intensity"], [-900, 200])


def test_pts_without_points(scratch):
    assert len(dw.read(scratch("none.pts", "0\n"))) == 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("3\n1 2 3\n4 5 6\n", "claims 3 points, the file holds 2"),
        ("1\n1 2 3\n4 5 6\n", "claims 1 points, the file holds more"),
        ("0\n1 2 3\n", "claims 0 points, the file holds more"),
        ("1000000000000\n1 2 3\n4 5 6\n", "claims 1000000000000 points, the file holds 2"),
        ("5\n", "claims 5 points, the file holds 0"),
        ("1 2 3\n4 5 6\n", "line 1: a .pts file begins with the number of points"),
        ("many\n1 2 3\n", "line 1: expected a whole number, got 'many'"),
        ("-1\n1 2 3\n", "line 1: expected a whole number"),
        ("1\n1 2 3\n1\n1 2 3\n", "line 3: 1 values, expected 3|the file holds more"),
    ],
)
def test_bad_pts(scratch, content, message):
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("bad.pts", content))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# only\n// comments\n\n", "no points: the file has no row of numbers"),
        ("\n\n", "no points"),
        ("x,y,z\n", "no points"),
        ("1 2\n3 4\n", "rows have 2 values"),
        ("7\n1 2 3\n", "rows have 1 values"),
        ("1 2 3\n4 5\n", "line 2: 2 values, expected 3"),
        ("# a\n\n1 2 3\n# b\n\n4 5 6 # c\n7 8 9 1 # d\n", "line 7: 4 values, expected 3"),
        ("// a\n1 2 3\n// b\n7 8 9 1 // d\n", "line 4: 4 values, expected 3"),
        ("1 2 3\n4 east 6\n", "line 2: could not convert string 'east' to float64"),
        ("1,2,3\n4,,6\n", "line 2: could not convert string '' to float64"),
        ("1,2,3\n4,5,6,\n", "line 2: 4 values, expected 3"),
        ("x,y,z\nx,y,z\n1,2,3\n", "line 2: could not convert string 'x'"),
        ("x,y,z\n1,2,3,4\n", "3 column names, but 4 columns"),
        ("x,y,y,z\n1,2,3,4\n", "line 1: two columns are called 'y'"),
        ("a,b,c\n1,2,3\n", "line 1: neither numbers nor column names with x, y, z: 'a b c'"),
        ("1,5 2,5 3,5\n", "line 1: neither numbers nor column names"),
        ("x,y,z,points\n1,2,3,4\n", "called 'points'"),
        ("\0\1\2\3\n", "line 1: not text"),
        ("a" * 100_000, "line 1: not text"),
        ("1 2 3\n" * 9000 + "1 2\n", "line 9001: 2 values, expected 3"),
        ("1 2 3\r" * 9000 + "1 2\r", "line 9001: 2 values, expected 3"),
    ],
)
def test_bad_text(scratch, content, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.read(scratch("bad.txt", content))
    assert "bad.txt" in str(caught.value)


def test_map_coordinates_need_an_offset(scratch):
    path = scratch("utm.csv", "x,y,z\n500000.123,5400000.456,1.5\n")
    with pytest.raises(InputError, match=r"utm\.csv.*offset"):
        dw.read(path)
    cloud = dw.read(path, offset=(5e5, 5.4e6, 0))
    np.testing.assert_allclose(cloud.points_world, [[0.123, 0.456, 1.5]], atol=1e-7)


def test_no_warning_of_numpy_leaks(scratch):
    """Blank lines before the claimed end make loadtxt warn; here they are just blank lines."""
    path = scratch("blank.pts", "2\n\n0.5 -1.25 3\n\n4 5.5 -6\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        np.testing.assert_array_equal(dw.read(path).points_world, POINTS)
    assert caught == []


@given(
    points=hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 20), st.just(3)),
        elements=st.floats(-8192, 8192, width=32) | st.sampled_from([np.nan, np.inf, -np.inf]),
    ),
    delimiter=st.sampled_from([" ", "\t", ",", ";", " , "]),
    suffix=st.sampled_from([".xyz", ".txt", ".csv", ".pts"]),
)
def test_shortest_decimal_text_gives_back_every_bit(scratch, points, delimiter, suffix):
    rows = [delimiter.join(str(value) for value in row) for row in points]
    lines = [str(len(rows))] * (suffix == ".pts") + rows
    back = dw.read(scratch("round" + suffix, "\n".join(lines) + "\n")).points_world
    np.testing.assert_array_equal(back, points)
    finite = np.isfinite(points)  # a NaN has no sign or payload in text
    assert back[finite].tobytes() == points[finite].tobytes()
