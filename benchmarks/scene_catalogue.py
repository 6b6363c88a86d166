"""All scenes by name."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.real_scenes import KitchenScene, KittiScene, RealScene, RoomScanScene
from benchmarks.scenes import (
    AerialScene,
    FurnishedScene,
    Order,
    RoomScene,
    ScanScene,
    Scene,
    UniformScene,
)
from depthwarp.errors import InputError

__all__ = ["SCENES", "chosen_scenes"]

SCENES: dict[str, type[Scene]] = {
    "room": RoomScene,
    "uniform": UniformScene,
    "scan": ScanScene,
    "furnished": FurnishedScene,
    "aerial": AerialScene,
    "room_scan": RoomScanScene,
    "kitti": KittiScene,
    "kitchen": KitchenScene,
}


def chosen_scenes(names: Sequence[str], counts: Sequence[int], order: Order) -> list[Scene]:
    """Scenes of some names; made ones of each number of points, or of their usual ones.

    Raises:
        InputError: There is no scene of a name.
    """
    scenes = []
    for name in names:
        if name not in SCENES:
            raise InputError(f"there is no scene '{name}': choose from {', '.join(SCENES)}")
        kind = SCENES[name]
        is_real = issubclass(kind, RealScene)
        asked = kind.usual_counts if is_real or not counts else counts
        scenes += [kind(count, order=order) for count in asked]
    return scenes
