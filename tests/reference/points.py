"""What the tests of the references share: points to write by hand, and the two precisions."""

from __future__ import annotations

import math

import numpy as np

DTYPES = [np.float32, np.float64]
NAN, INF = math.nan, math.inf


def columns(points, dtype):
    """The X, Y, Z arrays of a list of points."""
    return tuple(np.array(points, dtype=dtype).T)
