"""Depth maps side by side: one scale for both, marks where they belong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp import plots
from depthwarp.errors import InputError

pytest.importorskip("matplotlib")

NEAR, FAR = np.full((60, 70), 2.0), np.full((60, 70), 6.0)
NEAR[:20] = 0.0  # empty
NOTHING = np.zeros((60, 70), bool)
MARKED = NOTHING.copy()
MARKED[40:, :35] = True
LEFT, TOP, ZOOM, ACROSS = 120, 235, 8, 630
"""Where the first map begins, the side of its pixels, and how far the second is from it [px]."""


def draw(path: Path) -> np.ndarray:
    """Two maps, the second of them marked, as drawn."""
    plots.plot_depth_maps((NEAR, FAR), (NOTHING, MARKED), ("first", "second"), path)
    return cv2.imread(str(path)).astype(int)


def pixel(image: np.ndarray, which: int, row: int, column: int) -> np.ndarray:
    """The colour (blue, green, red) in the middle of a map's pixel."""
    return image[TOP + ZOOM * row + 4, LEFT + ACROSS * which + ZOOM * column + 4]


def test_two_maps_share_one_scale(tmp_path):
    """The far map is white and the near one dark grey, though each has one depth alone."""
    image = draw(tmp_path / "maps.png")
    assert image.shape == (60 * ZOOM + 95 + 235, LEFT + 2 * ACROSS + 150, 3)
    assert (pixel(image, 1, 10, 60) >= 253).all()
    near = pixel(image, 0, 50, 10)
    assert np.ptp(near) == 0 and 40 < near[0] < 90
    assert (pixel(image, 0, 10, 10) == 0).all()


def test_marked_pixels_are_tinted_and_the_others_are_not(tmp_path):
    """Pink over the depth, in the map that the mask is of."""
    image = draw(tmp_path / "maps.png")
    blue, green, red = pixel(image, 1, 50, 10)
    assert red > 220 and green < 170 and blue > 170
    assert (pixel(image, 1, 50, 60) >= 253).all()
    assert np.ptp(pixel(image, 0, 50, 10)) == 0


def test_nothing_is_cut_off(tmp_path):
    """Labels and captions end before the borders of the page."""
    dark = draw(tmp_path / "maps.png") < 200
    assert not dark[:5].any() and not dark[-5:].any()
    assert not dark[:, :5].any() and not dark[:, -5:].any()


@pytest.mark.parametrize(
    ("depths", "marked", "captions", "message"),
    [
        ((), (), (), "at least one"),
        ((NEAR, FAR), (NOTHING,), ("a", "b"), "got 2, 1 and 2"),
        ((NEAR, FAR[1:]), (NOTHING, NOTHING), ("a", "b"), r"depths\[1\] must have shape"),
        ((NEAR,), (NOTHING[1:],), ("a",), r"marked\[0\] must have shape"),
    ],
)
def test_what_does_not_fit_together_is_named(tmp_path, depths, marked, captions, message):
    """Counts and sizes are checked, and nothing is left behind."""
    with pytest.raises(InputError, match=message):
        plots.plot_depth_maps(depths, marked, captions, tmp_path / "maps.png")
    assert not list(tmp_path.iterdir())
