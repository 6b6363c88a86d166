"""The kernels' arc tangent: the reference's bits, NumPy's value."""

from __future__ import annotations

import numpy as np

from tests.cameras.device_image import device_angles
from tests.reference import lenses


def test_angles_are_those_of_the_reference_and_right(device):
    """All round, of all magnitudes, on axes: within 2 units in the last place of pi."""
    rng = np.random.default_rng(1)
    turn = rng.uniform(-np.pi, np.pi, 200_000)
    size = 10.0 ** rng.uniform(-15, 15, turn.size)
    y, x = (np.float32(size * side) for side in (np.sin(turn), np.cos(turn)))
    corners = np.float32([0.0, -0.0, 1, -1, 3e38, -3e38, 0.41421357, 1e-30, -1e-30])
    pairs = np.array(np.meshgrid(corners, corners)).reshape(2, -1)
    y, x = np.concatenate([y, pairs[0]]), np.concatenate([x, pairs[1]])
    angles = device_angles(y, x, device)
    np.testing.assert_array_equal(angles, lenses.angle_of(y, x))  # but for the sign of 0
    error = abs(angles - np.arctan2(y.astype(np.float64), x.astype(np.float64)))
    # The sign of 0 does not turn the angle by a whole turn, as it does in C's function.
    error = np.minimum(error, 2 * np.pi - error)
    error = error[(x != 0) | (y != 0)]
    print(f"angle_of: at most {error.max():.2e} rad off")
    assert error.max() < 4.8e-7
