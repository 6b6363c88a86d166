"""What went wrong in which world: noted on the device, read when somebody asks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp_kernels.poses import BAD_POSE
from depthwarp_kernels.spans import NEGATIVE_COUNT, SURPLUS

__all__ = ["DeviceStatus", "WorldStatus"]


@dataclass(frozen=True)
class WorldStatus:
    """What went wrong in each of W worlds since somebody last asked.

    Attributes:
        surplus: Most points of a step beyond the room for them, which were not drawn, shape (W,).
        negative_count: Whether a count of points was below 0; it counted as 0. Shape (W,).
        bad_pose: Whether a pose was not finite or no rotation; that image was empty. Shape (W,).
    """

    surplus: npt.NDArray[np.int32]
    negative_count: npt.NDArray[np.bool_]
    bad_pose: npt.NDArray[np.bool_]

    @property
    def is_clean(self) -> bool:
        """Whether nothing went wrong in any world."""
        return not (self.surplus.any() or self.negative_count.any() or self.bad_pose.any())

    def __str__(self) -> str:
        parts = [
            f"{text} in world {_listed(worlds)}"
            for text, worlds in (
                (f"up to {self.surplus.max(initial=0)} points too many", self.surplus > 0),
                ("a negative count of points", self.negative_count),
                ("a pose that is not finite or no rotation", self.bad_pose),
            )
            if worlds.any()
        ]
        return "; ".join(parts) or "nothing went wrong"


class DeviceStatus:
    """Flags of worlds on the device; they stay until they are read.

    Attributes:
        flags: Bits, `wp.int32`, shape (W,).
        surplus: Most points of a step beyond the room for them, `wp.int32`, shape (W,).
    """

    def __init__(self, worlds: int, device: Any) -> None:
        self.flags = arrays.zeros(worlds, wp.int32, device)
        self.surplus = arrays.zeros(worlds, wp.int32, device)

    def read(self) -> WorldStatus:
        """What was noted since the last reading; waits for the device, on all of its streams."""
        device = self.flags.device
        wp.synchronize_device(device)
        flags, surplus = self.flags.numpy().copy(), self.surplus.numpy().copy()
        self.flags.zero_()
        self.surplus.zero_()
        wp.synchronize_device(device)  # the next step may run on another stream
        negative, bad = int(NEGATIVE_COUNT), int(BAD_POSE)
        return WorldStatus(
            surplus=np.where(flags & int(SURPLUS), surplus, 0).astype(np.int32),
            negative_count=(flags & negative) != 0,
            bad_pose=(flags & bad) != 0,
        )


def _listed(worlds: npt.NDArray[np.bool_]) -> str:
    """The first few of them."""
    numbers = np.flatnonzero(worlds)
    text = ", ".join(map(str, numbers[:5]))
    return text if len(numbers) <= 5 else f"{text} and {len(numbers) - 5} more"
