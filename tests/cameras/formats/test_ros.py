"""ROS's CameraInfo files: the forms in which they are written, and what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras.formats import flat_yaml
from depthwarp.errors import FileFormatError, InputError

WRITTEN = """image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [438.75, 0.0, 305.5, 0.0, 437.25, 247.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3125, 0.0625, 0.00125, -0.0005, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [393.65, 0.0, 322.79, 0.0, 0.0, 393.65, 241.09, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
"""As `camera_calibration_parsers` writes it."""

OTHER_WRITERS = {
    "lists over lines": WRITTEN.replace(
        "[438.75, 0.0, 305.5, 0.0, 437.25, 247.5, 0.0, 0.0, 1.0]",
        "[ 438.75,   0., 305.5, # first row\n     0., 437.25,\n 247.5,\n\n         0., 0., 1. ]",
    ),
    "lists by dashes": WRITTEN.replace(
        "[-0.3125, 0.0625, 0.00125, -0.0005, 0.0]", "\n  - -0.3125\n  - 6.25e-2\n  - 1.25e-03"
    ).replace("1.25e-03", "1.25e-03\n  - -5E-4\n  - 0"),
    "dashes indented": WRITTEN.replace(
        "  data: [-0.3125, 0.0625, 0.00125, -0.0005, 0.0]",
        "  data:\n    - -0.3125\n    - 0.0625\n    - 0.00125\n    - -0.0005\n    - 0.0",
    ),
    "comments and a start": "# made by hand\n---\n" + WRITTEN.replace("640", "640 # columns"),
    "deeper indentation": WRITTEN.replace("\n  ", "\n      "),
    "maps in braces": re.sub(
        r":\n  rows: (\d)\n  cols: (\d)\n  data: (.*)", r": {rows: \1, cols: \2, data: \3}", WRITTEN
    ),
    "comments behind quotes": WRITTEN.replace("plumb_bob", '"plumb_bob"  # the "usual" one'),
    "four coefficients": WRITTEN.replace("cols: 5", "cols: 4").replace("-0.0005, 0.0]", "-0.0005]"),
    "quotes": WRITTEN.replace("plumb_bob", '"plumb_bob"').replace(
        "narrow_stereo/left", "'narrow_stereo/left'"
    ),
    "no model, as in old files": WRITTEN.replace("distortion_model: plumb_bob\n", ""),
    "windows": WRITTEN.replace("\n", "\r\n"),
    "byte order mark": "\ufeff" + WRITTEN,
    "trivial binning and roi": WRITTEN
    + "binning_x: 1\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  height: 480\n"
    + "  width: 640\n  do_rectify: false\n",
}

K = [[438.75, 0, 305.5], [0, 437.25, 247.5], [0, 0, 1]]
BROWN = dw.PinholeCamera.from_matrix(K, (640, 480), (-0.3125, 0.0625, 0.00125, -0.0005))
CAMERAS = {
    "ideal": dw.PinholeCamera.from_matrix(K, (640, 480)),
    "brown": BROWN,
    "rational": dw.PinholeCamera.from_matrix(
        K, (640, 480), (0.5, 0.1, 1e-3, -1e-3, 0.01, 0.8, 0.2, 0.03)
    ),
    "prism": dw.PinholeCamera.from_matrix(
        K, (640, 480), (0.5, 0.1, 1e-3, -1e-3, 0.01, 0.8, 0.2, 0.03, 1e-3, 1e-4, 0, 1e-17)
    ),
    "fisheye": dw.FisheyeCamera.from_matrix(K, (640, 480), (-0.01, 0.004, 0.001, 1 / 3000)),
}


@pytest.mark.parametrize("text", [WRITTEN, *OTHER_WRITERS.values()], ids=["", *OTHER_WRITERS])
def test_every_writers_form_is_read(tmp_path, text):
    """The raw image's lens, in its own optical frame, under the camera's name."""
    path = tmp_path / "left.yaml"
    path.write_bytes(text.encode())
    rig = dw.cameras.load_rig(path)
    assert rig.names == ("narrow_stereo/left",)
    assert dw.cameras.load(path) == BROWN
    np.testing.assert_array_equal(rig.cameras[0].pose.optical_from_world, np.eye(4))


@pytest.mark.parametrize("name", CAMERAS)
def test_what_is_written_is_read_back(tmp_path, name):
    """An equal camera, to the last bit, for each distortion model, whatever its name."""
    path = tmp_path / "info.yaml"
    for title in (name, "a: 'b' # \"c\" é", "[x]"):
        rig = dw.cameras.Rig.of({title: CAMERAS[name]})
        dw.cameras.save(rig, path, format="ros")
        assert dw.cameras.load_rig(path) == rig
    model = {"fisheye": "equidistant", "rational": "rational_polynomial"}.get(name)
    assert model is None or f"distortion_model: {model}\n" in path.read_text()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("plumb_bob", "thin_plate", "unknown distortion_model 'thin_plate'; known are plumb_bob"),
        ("plumb_bob", "equidistant", "equidistant has 4 coefficients, got 5"),
        ("plumb_bob", "rational_polynomial", "has 8 or 12 or 14 coefficients, got 5"),
        ("distortion_coefficients", "distortion_coefficents", "no entry 'distortion_coefficients'"),
        ("projection_matrix", "projection", "no entry 'projection_matrix'"),
        ("438.75", "0.0", "fx must be a finite number above 0"),
        ("438.75, 0.0", "438.75, 0.5", "skew"),
        ("438.75", ".nan", "camera_matrix must be finite numbers, got '.nan'"),
        ("data: [1.0, 0.0", "data: [0.9, 0.0", "rectification_matrix: .*not a rotation .* by 0.19"),
        ("438.75", "nan", "finite"),
        ("438.75, ", "", "camera_matrix does not hold 3 x 3 numbers"),
        ("cols: 4", "cols: 3", "projection_matrix does not hold 3 x 3 numbers"),
        ("rows: 3\n  cols: 4", "rows: 4\n  cols: 3", "projection_matrix is not 3 x 4"),
        ("image_width: 640", "image_width: 640.5", "whole numbers"),
        ("image_width: 640", "image_width: wide", "could not convert"),
        ("image_width: 640", "image_width: -640", "from 1 to"),
        ("image_width: 640", "image_width:", "image_width is not a number"),
        ("distortion_model", "binning_x: 2\ndistortion_model", "binning_x is 2"),
        ("distortion_model", "roi:\n  x_offset: 8\ndistortion_model", "roi.x_offset is 8"),
        ("distortion_model", "roi:\n  width: 320\ndistortion_model", "roi.width is 320"),
        ("distortion_model", "roi: 3\ndistortion_model", "roi is not a map"),
        ("[438.75", "438.75", "camera_matrix does not hold"),
        ("camera_matrix:\n", "camera_matrix: 3\n", "line 5: 'rows: 3' is indented under no key"),
        ("0.0]\nrectification", "0.0\nrectification", "line 12: .*no end|behind a list"),
    ],
)
def test_bad_content_is_refused(tmp_path, old, new, message):
    """The message names the file, and the entry or the line."""
    path = tmp_path / "bad.yaml"
    assert old in WRITTEN
    path.write_text(WRITTEN.replace(old, new, 1))
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.cameras.load(path)
    assert "bad.yaml" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2", "line 2: 'a' stands twice"),
        ("a:\n  b: 1\n  b: 2", "line 3: 'b' stands twice"),
        ("a:\n  b: 2\n    c: 1", "line 3: 'c: 1' is indented under no key"),
        ("a:\n    b: 2\n  c: 1", "line 3: 'c: 1' is indented otherwise than above"),
        ("a: 1\n---\nb: 2", "line 3: a second document; keep one"),
        ("a:\n\tb: 1", "line 2: indented with a tab"),
        ("a: &anchor 1", "line 1: a value of a form"),
        ("a: *anchor", "line 1: a value of a form"),
        ("a: !!float 1", "line 1: a value of a form"),
        ("a: {b: {c: 1}}", "line 1: a value of a form"),
        ("a: {b: 1, b: 2}", "line 1: a value of a form"),
        ("a: {b: 1} c", "line 1: text behind a map"),
        ("a: {b: [1}", "line 1: the list in brackets has no end"),
        ("a: |\n  text", "line 1: a value of a form"),
        ("a: [[1, 2], [3, 4]]", "line 1: a value of a form"),
        ('a: "open', "line 1: not a text in quotes"),
        ("a: 'open", "line 1: a value of a form"),
        ("b: 1\na: [1, 2", "line 2: the list in brackets has no end"),
        ("a: [1, 2] 3", "line 1: text behind a list"),
        ("a: [1, , 2]", "line 1: a value of a form"),
        ("- 1", "line 1: an item without a list"),
        ("a: 1\n- 2", "line 2: an item without a list"),
        ("  a: 1", "line 1: 'a: 1' is indented under no key"),
        ("hello", "line 1: not of the form"),
        ("a:1", "line 1: not of the form"),
    ],
)
def test_yaml_beyond_the_flat_form_is_refused_with_its_line(text, message):
    """Never read as something else."""
    with pytest.raises(ValueError, match=message):
        flat_yaml.parse(text)


def test_the_flat_form_of_yaml():
    """Values stay texts; keys without one have None."""
    text = "a: 1\nb:\nc: [1, 2.5,]\nd:\n  e: x y\n  f:\n  - 1\n  - 2\ng: ~\nh: []\nk: 'it''s'\n"
    expected = {"a": "1", "b": None, "c": ["1", "2.5"], "d": {"e": "x y", "f": ["1", "2"]}}
    assert flat_yaml.parse(text) == expected | {"g": None, "h": [], "k": "it's"}
    assert flat_yaml.parse("") == {}


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    """A pose, several cameras, another model: the message says what to do, nothing is written."""
    placed = BROWN.with_pose(dw.Pose.from_orientation((1, 2, 3), (0, 0, 0)))
    with pytest.raises(InputError, match=r"holds no pose.*with_pose\(Pose.from_optical"):
        dw.cameras.save(placed, tmp_path / "a.yaml", format="ros")
    with pytest.raises(InputError, match="one camera, the rig has 5"):
        dw.cameras.save(dw.cameras.Rig.of(CAMERAS), tmp_path / "a.yaml", format="ros")
    other = dw.DoubleSphereCamera(300, 300, 320, 240, 0.1, 0.5, 640, 480, placed.pose)
    with pytest.raises(InputError, match="no model for a DoubleSphereCamera"):
        dw.cameras.save(other, tmp_path / "a.yaml", format="ros")
    assert not list(tmp_path.iterdir())


HEADER = """header:
  stamp:
    sec: 1700000000
    nanosec: 120000000
  frame_id: camera
height: 480
width: 640
"""
LISTS = {
    "d": (-0.3125, 0.0625, 0.00125, -0.0005, 0.0),
    "k": (438.75, 0.0, 305.5, 0.0, 437.25, 247.5, 0.0, 0.0, 1.0),
    "r": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    "p": (393.5, 0.0, 322.5, 0.0, 0.0, 393.5, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0),
}
ROI = "roi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: false\n---\n"


def message(model, lists, *, capital=False):
    """A message as ROS 2 prints it: lists by dashes; or as ROS 1 does: capitals, brackets."""
    text = HEADER + f"distortion_model: {model}\n"
    for name, values in lists.items():
        if capital:
            text += f"{name.upper()}: {list(values)}\n"
        else:
            text += f"{name}:\n" + "".join(f"- {value}\n" for value in values)
    return text + "binning_x: 0\nbinning_y: 0\n" + ROI


@pytest.mark.parametrize("capital", [False, True], ids=["ROS 2", "ROS 1"])
def test_a_printed_message_is_read(tmp_path, capital):
    """`ros2 topic echo --once` and `rostopic echo -n 1`; what stands in them twice is refused."""
    path = tmp_path / "info.yaml"
    path.write_text(message("plumb_bob", LISTS, capital=capital))
    assert dw.cameras.load(path) == BROWN
    path.write_text(message("plumb_bob", LISTS, capital=capital) * 2)
    with pytest.raises(FileFormatError, match="a second document; keep one"):
        dw.cameras.load(path)
    binned = message("plumb_bob", LISTS, capital=capital).replace("binning_x: 0", "binning_x: 2")
    path.write_text(binned)
    with pytest.raises(FileFormatError, match="binning_x is 2"):
        dw.cameras.load(path)


def test_a_message_that_was_cut_short_is_refused_or_the_same_camera(tmp_path):
    """At any place; numbers that are not used may be missing a digit."""
    path, refused = tmp_path / "info.yaml", 0
    text = message("plumb_bob", LISTS)
    for length in range(1, len(text), 3):
        path.write_text(text[:length])
        try:
            assert dw.cameras.load(path, size=(640, 480)) == BROWN
        except FileFormatError:
            refused += 1
    assert refused > 75


@pytest.mark.parametrize("capital", [False, True], ids=["ROS 2", "ROS 1"])
def test_fisheye_is_another_name_of_equidistant(tmp_path, capital):
    """The four coefficients are those of the angle's polynomial."""
    path = tmp_path / "info.yaml"
    path.write_text(message("fisheye", LISTS | {"d": (-0.01, 0.004, 0.001, 0)}, capital=capital))
    expected = dw.FisheyeCamera.from_matrix(K, (640, 480), (-0.01, 0.004, 0.001, 0))
    assert dw.cameras.load(path) == expected


@pytest.mark.parametrize("lost", ["image_width: 640\n", "image_height: 480\n"])
def test_a_missing_size_has_a_remedy(tmp_path, lost):
    """The argument stands in; it must agree with the side that the file has."""
    path = tmp_path / "info.yaml"
    path.write_text(WRITTEN.replace(lost, ""))
    with pytest.raises(InputError, match=r"image_width or .*give size=\(width, height\)"):
        dw.cameras.load(path)
    assert dw.cameras.load(path, size=(640, 480)) == BROWN
    with pytest.raises(InputError, match="size says 320 x 240"):
        dw.cameras.load(path, size=(320, 240))
