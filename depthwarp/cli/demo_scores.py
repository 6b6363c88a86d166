"""How much of the demo's depth maps there is, and how much of it is right: the room is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from depthwarp.cameras import Camera
    from depthwarp.depth_map import DepthMap

__all__ = ["RIGHT_WITHIN", "MapScore", "room_depth", "score_map", "wrong_pixels"]

RIGHT_WITHIN = 0.05
"""A depth is right when it differs by at most this from the room's [m]."""


@dataclass(frozen=True)
class MapScore:
    """Shares of all pixels of a map.

    Attributes:
        covered: With a depth.
        measured: With the depth of the point that fell there.
        filled: With a depth that a filter wrote, inside a surface or at its border.
        right: With a depth at most `RIGHT_WITHIN` from the room's.
        wrong: With another depth.
    """

    covered: float
    measured: float
    filled: float
    right: float
    wrong: float

    def __str__(self) -> str:
        """The shares in words."""
        return (
            f"{self.covered:.0%} of the pixels hold a depth "
            f"({self.measured:.1%} measured, {self.filled:.1%} filled): "
            f"{self.right:.0%} within {100 * RIGHT_WITHIN:g} cm of the room, "
            f"{self.wrong:.0%} farther off"
        )


def room_depth(camera: Camera) -> NDArray[np.float64]:
    """The exact range [m] from a camera to the demo's room, shape (H, W), inf beside it."""
    from depthwarp.scanner.room import furnished_room

    rows, columns = np.indices((camera.height, camera.width))
    rays = camera.directions(columns, rows).reshape(-1, 3) @ camera.pose.rotation
    distance, _ = furnished_room().cast(camera.pose.center_world, rays)
    return distance.reshape(rows.shape)


def wrong_pixels(depth_map: DepthMap, exact: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where a map of ranges has a depth, but not the exact one, shape (H, W)."""
    far_off = np.abs(depth_map.depth - exact) > RIGHT_WITHIN
    return np.asarray((depth_map.depth > 0) & far_off)


def score_map(depth_map: DepthMap, exact: NDArray[np.float64]) -> MapScore:
    """Score a map of ranges against the exact ones, shape (H, W)."""
    from depthwarp.depth_map import State

    covered = depth_map.depth > 0
    wrong = wrong_pixels(depth_map, exact)
    filled = np.isin(depth_map.state, (State.FILLED, State.FILLED_BORDER))
    return MapScore(
        covered=float(covered.mean()),
        measured=float((depth_map.state == State.MEASURED).mean()),
        filled=float(filled.mean()),
        right=float((covered & ~wrong).mean()),
        wrong=float(wrong.mean()),
    )
