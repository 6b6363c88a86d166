"""What chains do to depth maps on the host."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

import depthwarp as dw

__all__ = ["Step", "erase_where", "filled"]

Step = Callable[[dw.DepthMap, dw.PointCloud], dw.DepthMap]
"""From a map and the cloud that it shows to another map."""


def erase_where(depth_map: dw.DepthMap, mask: npt.NDArray[np.bool_]) -> dw.DepthMap:
    """The map without the measured pixels of a mask, shape (H, W)."""
    gone = mask & (depth_map.state == dw.State.MEASURED)
    return replace(
        depth_map,
        depth=np.where(gone, np.float32(0), depth_map.depth),
        index=np.where(gone, np.int32(-1), depth_map.index),
        state=np.where(gone, np.uint8(dw.State.ERASED), depth_map.state),
    )


def filled(depth_map: dw.DepthMap, depth: npt.NDArray[Any]) -> dw.DepthMap:
    """The map with another depth [m], shape (H, W); new pixels are marked as filled."""
    new = (depth_map.depth == 0) & (depth > 0)
    state = np.where(new, np.uint8(dw.State.FILLED), depth_map.state)
    return replace(depth_map, depth=depth.astype(np.float32), state=state)
