"""What the tests of the range view share: the paper's own view, and the two precisions."""

from __future__ import annotations

import numpy as np

import depthwarp as dw

DTYPES = [np.float32, np.float64]
PAPER = dw.RangeView(position=(1.79, 3.3, 1.2), orientation=(0, 0, 90), fov=(60, 60))
