"""Cases: a scene, how many rays scan it, clean or dirty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from benchmarks.quality.scenes import SCENES, Scene
from benchmarks.quality.truth import View, look
from benchmarks.quality.world import World

__all__ = ["RAYS", "Case", "Stage", "cases", "stage"]

RAYS = (200_000, 500_000, 1_000_000, 2_000_000)


@dataclass(frozen=True)
class Case:
    """A cloud to be made.

    Attributes:
        scene: Name of the scene.
        rays: Rays of all scan positions together.
        dirty: With mixed pixels and strays.
    """

    scene: str
    rays: int
    dirty: bool = False

    @property
    def name(self) -> str:
        """Such as "room 0.2M dirty"."""
        return f"{self.scene} {self.rays / 1e6:g}M" + (" dirty" if self.dirty else "")


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene ready for scans: its solids in their tree, and the truth of its views."""

    scene: Scene
    world: World
    views: tuple[View, ...]


@cache
def stage(name: str, views: int) -> Stage:
    """The stage of a scene, with the first so many of its views."""
    scene = SCENES[name]()
    world = World(scene.solids)
    return Stage(scene, world, tuple(look(scene, world, where) for where in scene.looks[:views]))


def cases(scenes: Sequence[str], rays: Sequence[int], dirty: Sequence[bool]) -> list[Case]:
    """Every scene with every number of rays, clean before dirty as asked."""
    return [Case(scene, count, bad) for scene in scenes for count in rays for bad in dirty]
