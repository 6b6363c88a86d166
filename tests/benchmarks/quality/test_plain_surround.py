"""The plain surround rule, against loops over all pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.quality.plain_surround import hidden_pixels

PITCH = (1 / 300, 0.0)


def spacing_of(depth: np.ndarray, row: int, column: int) -> int:
    """The smallest ring with four of the same layer inside, 33 without one."""
    z = depth[row, column]
    others = [
        (max(abs(r - row), abs(c - column)), abs(depth[r, c] - z))
        for r, c in np.argwhere(depth > 0)
        if (r, c) != (row, column)
    ]
    rings = sorted(ring for ring, apart in others if apart <= 0.03 + 1.5 * ring * PITCH[0] * z)
    return rings[3] if len(rings) > 3 and rings[3] <= 32 else 33


def is_hidden(depth: np.ndarray, spacing: dict[tuple, int], row: int, column: int) -> bool:
    """The rule for one pixel, over the nearest of every area beside its own."""
    limit = min(max(6 * float(np.median(list(spacing.values()))), 12), 32)
    z, sectors = float(depth[row, column]), set()
    for level in range(5):
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                area = ((row >> level) + down, (column >> level) + right)
                of_area = [
                    (depth[r, c], r, c)
                    for (r, c), s in spacing.items()
                    if (r >> level, c >> level) == area and s <= limit
                ]
                if not of_area:
                    continue
                near, r, c = min(of_area)
                way = math.hypot(r - row, c - column)
                margin = 0.02 + 0.002 * z + 1.5 * way * PITCH[0] * float(near)
                if z - near > margin and way <= 1.5 * spacing[r, c]:
                    turn = math.atan2(r - row, c - column) / (2 * math.pi) % 1.0
                    sectors.add(int(16 * turn + 1e-9) % 16)
    return not any(all((first + k) % 16 not in sectors for k in range(9)) for first in range(16))


@pytest.mark.parametrize("share", [0.08, 0.3])
def test_it_is_the_rule_of_its_description(share):
    """Two mingled walls of random pixels: every pixel as the loop says, some hidden, some not."""
    rng = np.random.default_rng(1)
    depth = np.where(rng.random((30, 34)) < 0.6, 2.0, 4.0).astype(np.float32)
    depth += 0.001 * rng.random(depth.shape, dtype=np.float32)  # no two of one depth
    depth[rng.random(depth.shape) > share] = 0
    found = hidden_pixels(depth, PITCH)
    expected = np.zeros(depth.shape, bool)
    spacing = {(r, c): spacing_of(depth, r, c) for r, c in np.argwhere(depth > 0)}
    for row, column in spacing:
        expected[row, column] = is_hidden(depth, spacing, row, column)
    np.testing.assert_array_equal(found, expected)
    assert 0 < found.sum() < (depth > 3).sum()


def test_a_sparse_plate_hides_the_wall_behind_it():
    """All of the dense wall that shows between the plate's pixels, and none beside the plate."""
    depth = np.full((72, 80), 4.0, np.float32)
    depth[16:57:4, 16:65:4] = 2.0
    hidden = hidden_pixels(depth, PITCH)
    behind, near = np.zeros_like(hidden), np.zeros_like(hidden)
    behind[16:57, 16:65] = depth[16:57, 16:65] > 3
    near[10:63, 10:71] = True  # the plate's spacing is 4 px: it reaches 6
    assert hidden[behind].all() and behind.sum() == 41 * 49 - 11 * 13
    assert not hidden[~near].any() and not hidden[depth < 3].any()


def test_strays_round_a_pixel_hide_nothing():
    """Each of another depth and so without a surface, on all sides of the wall's pixels."""
    depth = np.full((60, 60), 6.0, np.float32)
    angle = np.arange(16) * np.pi / 8
    rows, columns = (np.rint(30 + 12 * part(angle)).astype(int) for part in (np.sin, np.cos))
    depth[rows, columns] = 1.0 + 0.2 * np.arange(16)
    assert not hidden_pixels(depth, PITCH).any()
    depth[rows, columns] = 1.0  # of one surface they hide what they stand round
    assert hidden_pixels(depth, PITCH)[30, 30]


@pytest.mark.parametrize(("share", "most"), [(1.0, 0.0), (0.15, 0.05)])
def test_a_floor_stays(share, most):
    """At a grazing angle, up to 20 m: all of a full one, and 95 % of one with gaps at random.

    What lies on one side of a line may leave a run of 7 sectors of 16: the rule's own weakness.
    """
    down = (np.arange(160) + 6.5) * PITCH[0]
    floor = np.repeat((0.4 / down)[:, None], 200, axis=1).astype(np.float32)
    floor[np.random.default_rng(2).random(floor.shape) > share] = 0
    assert hidden_pixels(floor, PITCH).sum() <= most * np.count_nonzero(floor)


def test_an_empty_map_has_nothing_hidden():
    """No pixel, no error."""
    assert not hidden_pixels(np.zeros((5, 7), np.float32), PITCH).any()
