"""Each figure is written whole, at its size, with its content where it belongs, or not at all."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from depthwarp import plots
from depthwarp.errors import InputError, MissingExtraError

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

Draw = Callable[[Path], None]
FULL: dict[str, Draw] = {
    "point_cloud": lambda path: plots.plot_point_cloud(POINTS, path),
    "rotated_cloud": lambda path: plots.plot_rotated_cloud(POINTS, TURN, path),
    "angles": lambda path: plots.plot_range_view_angles(POSITION, VIEW, TURN, (0, 0, 90), path),
    "range_view": lambda path: plots.plot_range_view(POINTS, POSITION, VIEW, path),
    "segmented": lambda path: plots.plot_segmented_points(POINTS, INSIDE, POSITION, VIEW, path),
    "surf": lambda path: plots.plot_surf(DEPTH, path),
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


@pytest.mark.parametrize("name", ["point_cloud", "segmented", "surf"])
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
    shown[:, 4] = 2.0 + 1.01 * plots.MOST_STEP
    cells = plots._surface_cells(shown)
    assert cells.shape == (3 * 4 - 1 - 3, 4, 3)  # one beside the empty pixel, a column of steps
    assert cells[:, :, 1].max() == 2.0


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
    ],
)
def test_wrong_shapes_are_refused_by_name(tmp_path, draw, name):
    with pytest.raises(InputError, match=name):
        draw(tmp_path / "figure.png")
    assert not list(tmp_path.iterdir())
