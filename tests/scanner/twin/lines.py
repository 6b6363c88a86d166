"""What the tests of the twin share: quiet sensors and the middle of a rendered line."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.twin import Sensor, Shot, TwinRenderer

CLEAN = Sensor(PixelFormat.BGR, bits=16).quiet()
"""No noise, and rounding far below what is measured."""


def line_light(renderer: TwinRenderer, angle: float, exposure_us: float) -> npt.NDArray[np.float64]:
    """Green light of the line alone, grey levels of 255, shape (H, W)."""
    lit, dark = (
        renderer.render(Shot(angle, on, exposure_us))[..., 1].astype(np.float64)
        for on in (True, False)
    )
    assert lit.max() < 65535, "the line is saturated: the test needs a shorter exposure"
    return (lit - dark) / 65535 * 255


def line_middle(light: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Intensity-weighted column of each row, NaN in rows without light."""
    total = light.sum(axis=1)
    columns = np.arange(light.shape[1])
    return np.where(total > 0, light @ columns / np.where(total > 0, total, 1.0), np.nan)
