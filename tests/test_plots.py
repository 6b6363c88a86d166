"""Each figure is written whole, at its size, with its content where it belongs, or not at all."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from depthwarp import plots
from depthwarp.errors import InputError, MissingExtraError
from depthwarp.plots.depth import MOST_STEP, surface_cells
from depthwarp.plots.layout import lay_out
from depthwarp.scanner.geometry import TurningAxis, reference_geometry
from depthwarp.scanner.triangulation import triangulate

pytest.importorskip("matplotlib")

POINTS = np.random.default_rng(0).uniform((-1, 0, 0), (3, 5, 2), (200, 3)).astype(np.float32)
NO_POINTS = np.zeros((0, 3), np.float32)
TURN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # equation (6) at 90 degrees
POSITION = (1.0, 0.5, 1.0)
CORNERS = np.array([[-0.5, 1.0, 0.5], [0.5, 1.0, 0.5], [0.5, 1.0, -0.5], [-0.5, 1.0, -0.5]])
VIEW = np.array([POSITION + n * CORNERS for n in (1.0, 2.0, 4.0)])
NO_VIEW = np.zeros((0, 4, 3))
INSIDE = POINTS[:, 1] > 2
DEPTH = np.zeros((6, 10), np.float32)
DEPTH[1:5, 2:8] = np.linspace(2.0, 4.0, 24).reshape(4, 6)

SCANNER = reference_geometry()
NORMAL = SCANNER.plane_normal
MIRRORED = replace(  # the laser to the left of the camera
    SCANNER,
    plane_normal=(NORMAL[0], 0.0, -NORMAL[2]),
    plane_distance=-SCANNER.plane_distance,
    axis=TurningAxis((0.0, -1.0, 0.0), (-0.5, 0.0, 0.0)),
)
FRAME = np.random.default_rng(2).integers(8, 20, (120, 90, 3)).astype(np.uint8)
FRAME[:, 30:33, 1] = (60, 120, 70)
FLOATS: Any = FRAME / 255
ROWS = np.arange(4, 116, dtype=np.int32)
COLUMNS = np.full(len(ROWS), 31.04)

Draw = Callable[[Path], None]
FULL: dict[str, Draw] = {
    "point_cloud": lambda path: plots.plot_point_cloud(POINTS, path),
    "rotated_cloud": lambda path: plots.plot_rotated_cloud(POINTS, TURN, path),
    "angles": lambda path: plots.plot_range_view_angles(POSITION, VIEW, TURN, (0, 0, 90), path),
    "range_view": lambda path: plots.plot_range_view(POINTS, POSITION, VIEW, path),
    "segmented": lambda path: plots.plot_segmented_points(POINTS, INSIDE, POSITION, VIEW, path),
    "surf": lambda path: plots.plot_surf(DEPTH, path),
    "setup": lambda path: plots.plot_setup(SCANNER, path),
    "mirrored_setup": lambda path: plots.plot_setup(MIRRORED, path),
    "frame": lambda path: plots.plot_frame(FRAME, ROWS, COLUMNS, path),
}
NONE = np.zeros(0, bool)
EMPTY: dict[str, Draw] = {
    "point_cloud": lambda path: plots.plot_point_cloud(NO_POINTS, path),
    "not_finite": lambda path: plots.plot_point_cloud(np.full((3, 3), np.nan), path),
    "one_point": lambda path: plots.plot_point_cloud(np.ones((1, 3)), path),
    "rotated_cloud": lambda path: plots.plot_rotated_cloud(NO_POINTS, TURN, path),
    "angles": lambda path: plots.plot_range_view_angles(POSITION, NO_VIEW, TURN, (0, 0, 0), path),
    "range_view": lambda path: plots.plot_range_view(NO_POINTS, POSITION, NO_VIEW, path),
    "segmented": lambda path: plots.plot_segmented_points(NO_POINTS, NONE, POSITION, VIEW, path),
    "depth_map": lambda path: plots.plot_depth_map(np.zeros((3, 4)), path),
    "surf": lambda path: plots.plot_surf(np.zeros((3, 4)), path),
    "one_pixel": lambda path: plots.plot_surf(np.ones((1, 1)), path),
    "flat_surf": lambda path: plots.plot_surf(np.full((3, 4), 2.0), path),
    "no_line": lambda path: plots.plot_frame(FRAME, [], [], path),
    "black_frame": lambda path: plots.plot_frame(0 * FRAME, [0], [0], path),
    "white_frame": lambda path: plots.plot_frame(0 * FRAME + 255, [119], [89], path),
    "one_pixel_frame": lambda path: plots.plot_frame(FRAME[:1, :1], [0], [0.4], path),
}


def read(path: Path) -> np.ndarray:
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    image = cv2.imread(str(path))
    assert image is not None
    return image


@pytest.mark.parametrize("name", FULL)
def test_each_figure_has_its_size_and_is_not_blank(tmp_path, name):
    FULL[name](tmp_path / "figure.png")
    image = read(tmp_path / "figure.png")
    assert image.shape == (900, 1200, 3)
    drawn = image[70:] < 200
    assert drawn.any(axis=2).sum() > 1500
    # Axes, labels and colour bar end before the borders of the page.
    assert not drawn[:, :5].any() and not drawn[:, -5:].any() and not drawn[-5:].any()


@pytest.mark.parametrize("name", EMPTY)
def test_empty_input_gives_a_picture(tmp_path, name):
    EMPTY[name](tmp_path / "figure.png")
    assert read(tmp_path / "figure.png").size > 0


@pytest.mark.parametrize("name", ["point_cloud", "segmented", "surf", "setup", "frame"])
def test_drawing_twice_gives_the_same_picture(tmp_path, name):
    images = []
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        FULL[name](tmp_path / folder / "figure.png")
        images.append(read(tmp_path / folder / "figure.png"))
    np.testing.assert_array_equal(images[0], images[1])


def test_a_depth_map_is_drawn_pixel_for_pixel(tmp_path):
    """Empty is black, every depth has its own place on a scale where darker is closer."""
    depth = np.random.default_rng(1).uniform(2.0, 5.0, (300, 420)).astype(np.float32)
    depth[::3, ::7] = 0.0
    plots.plot_depth_map(depth, tmp_path / "map.png")
    image = read(tmp_path / "map.png")
    assert image.shape == (300 + 140, 420 + 230, 3)
    inner = image[72:368, 82:498].astype(int)  # without the frame, which covers the border pixels
    shown = depth[2:-2, 2:-2]
    filled = depth[depth > 0]
    dark = filled.min() - (filled.max() - filled.min()) / 3
    grey = np.where(shown > 0, 255 * (shown - dark) / (filled.max() - dark), 0.0)
    assert np.abs(inner - grey[:, :, None]).max() <= 2  # the scale has 256 steps


def test_a_small_depth_map_is_drawn_in_squares(tmp_path):
    plots.plot_depth_map(DEPTH, tmp_path / "map.png")
    image = read(tmp_path / "map.png")
    assert image.shape == (6 * 40 + 140, 10 * 40 + 230, 3)
    middles = image[70 + 20 : 70 + 240 : 40, 80 + 20 : 80 + 400 : 40, 0].astype(int)
    assert (middles[DEPTH == 0] == 0).all()
    assert (np.diff(middles[DEPTH > 0]) > 0).all()
    assert middles[DEPTH > 0].min() > 50


def test_the_surface_leaves_out_empty_cells_and_steps():
    shown = np.full((4, 5), 2.0)
    shown[0, 0] = np.nan
    shown[:, 4] = 2.0 + 1.01 * MOST_STEP
    cells = surface_cells(shown)
    assert cells.shape == (3 * 4 - 1 - 3, 4, 3)  # one beside the empty pixel, a column of steps
    assert cells[:, :, 1].max() == 2.0


@pytest.mark.parametrize(("geometry", "side"), [(SCANNER, 1.0), (MIRRORED, -1.0)])
def test_the_setup_shows_the_numbers_of_the_geometry(geometry, side):
    """Baseline and toe-in are the reference's, and the drawn point is the one that is measured."""
    setup = lay_out(geometry)
    assert setup.baseline == pytest.approx(0.5)
    assert setup.toe_in == pytest.approx(math.degrees(math.atan(0.85)))
    assert setup.side == side
    # Seen from above, the axis is at the origin and the laser on it; the camera looks up.
    np.testing.assert_allclose(setup.above(setup.camera), (-0.5 * side, 0), atol=1e-12)
    np.testing.assert_allclose(setup.above(setup.laser), (0, 0), atol=1e-12)
    # In its own plane the laser starts at the origin, and the wall is ahead of it.
    np.testing.assert_allclose(setup.aside(setup.laser), (0, 0), atol=1e-12)
    assert setup.aside(setup.point)[0] > 1.0
    column, row = setup.pixel
    found = triangulate(geometry, [row], [column], 0.1, 0.0)
    np.testing.assert_allclose(found.points_world[0], setup.point, atol=1e-6)
    assert found.range_m[0] == pytest.approx(setup.range, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plane_normal": (0.0, 0.0, 1.0)}, "plane_normal"),
        ({"plane_normal": (1.0, 0.0, 0.0), "plane_distance": 0.0}, "plane_normal"),
        ({"plane_normal": (0.1, 0.0, -math.sqrt(0.99))}, "nowhere in the camera's view"),
        ({"lens": replace(SCANNER.lens, distortion=(-0.5, 0.0, 0.0, 0.0, 0.0))}, "no ray"),
    ],
)
def test_a_scanner_that_cannot_measure_is_not_drawn(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        plots.plot_setup(replace(SCANNER, **change), tmp_path / "setup.png")
    assert not list(tmp_path.iterdir())


def test_a_frame_has_marks_along_its_line_and_nowhere_else(tmp_path):
    """The frame is drawn upright and to scale: marks are where the points are."""
    plots.plot_frame(FRAME, ROWS, COLUMNS, tmp_path / "frame.png")
    drawn = read(tmp_path / "frame.png").astype(int)
    blue, green, red = (drawn[:, :700, channel] for channel in range(3))
    marks = (red > 180) & (green < 130) & (blue > 100)
    scale = 745 / 120
    top, left = 900 - 75 - 745, 85 + (600 - 90 * scale) / 2
    rows, columns = np.nonzero(marks)
    assert abs((columns.mean() - left) / scale - 0.5 - 31.04) < 0.2
    assert abs((rows.min() - top) / scale - 0.5 - ROWS[0]) < 1.0
    assert abs((rows.max() - top) / scale - 0.5 - ROWS[-1]) < 1.0
    assert np.ptp(columns) < 12


def test_a_frame_says_how_many_points_it_has_and_marks_80(tmp_path, monkeypatch):
    texts = []
    monkeypatch.setattr("matplotlib.figure.Figure.text", lambda *args, **_: texts.append(args[3]))
    plots.plot_frame(FRAME, ROWS, COLUMNS, tmp_path / "frame.png", title="Stop 7")
    plots.plot_frame(FRAME, ROWS[:9], COLUMNS[:9], tmp_path / "frame.png")
    assert texts[0] == "Stop 7: 112 measured points, 80 of them marked"
    assert texts[1] == "One measurement frame: 9 measured points, 9 of them marked"


@pytest.mark.parametrize("name", FULL)
def test_without_matplotlib_the_error_says_what_to_install(tmp_path, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r'pip install "depthwarp\[viz\]"'):
        FULL[name](tmp_path / "figure.png")
    assert not list(tmp_path.iterdir())


def test_a_target_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="does not exist"):
        plots.plot_point_cloud(POINTS, tmp_path / "missing" / "figure.png")
    with pytest.raises(InputError, match="PNG"):
        plots.plot_point_cloud(POINTS, tmp_path / "figure.pdf")

    def full_disk(*args: Any, **kwargs: Any) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", full_disk)
    with pytest.raises(InputError, match="figure.png: No space"):
        plots.plot_point_cloud(POINTS, tmp_path / "figure.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("draw", "name"),
    [
        (lambda path: plots.plot_point_cloud(POINTS[:, :2], path), "points"),
        (lambda path: plots.plot_rotated_cloud(POINTS, np.eye(4), path), "rotation"),
        (lambda path: plots.plot_range_view(POINTS, (0, 0), VIEW, path), "position"),
        (lambda path: plots.plot_range_view(POINTS, POSITION, VIEW[0], path), "rectangles"),
        (lambda path: plots.plot_range_view(POINTS, POSITION, VIEW * np.nan, path), "finite"),
        (lambda path: plots.plot_range_view_angles(POSITION, VIEW, TURN, (0, 90), path), "orient"),
        (
            lambda path: plots.plot_segmented_points(POINTS, INSIDE[1:], POSITION, VIEW, path),
            "selected",
        ),
        (lambda path: plots.plot_depth_map(np.zeros(3), path), "depth"),
        (lambda path: plots.plot_surf(np.zeros((0, 4)), path), "depth"),
        (lambda path: plots.plot_frame(FRAME[:, :, 0], ROWS, COLUMNS, path), "pixels_bgr"),
        (lambda path: plots.plot_frame(FRAME[:0], [], [], path), "pixels_bgr"),
        (lambda path: plots.plot_frame(FLOATS, ROWS, COLUMNS, path), "uint8"),
        (lambda path: plots.plot_frame(FRAME, ROWS, COLUMNS[1:], path), "columns"),
        (lambda path: plots.plot_frame(FRAME, [120], [0], path), "in the frame of 90 x 120"),
        (lambda path: plots.plot_frame(FRAME, [0], [np.nan], path), "in the frame"),
    ],
)
def test_wrong_shapes_are_refused_by_name(tmp_path, draw, name):
    with pytest.raises(InputError, match=name):
        draw(tmp_path / "figure.png")
    assert not list(tmp_path.iterdir())
