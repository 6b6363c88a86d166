"""The scenes: solids, places of the scanner, and views."""

from benchmarks.quality.scenes.hall import hall
from benchmarks.quality.scenes.room import room
from benchmarks.quality.scenes.scene import Look, Scene
from benchmarks.quality.scenes.slopes import slopes
from benchmarks.quality.scenes.street import street

__all__ = ["SCENES", "Look", "Scene"]

SCENES = {"room": room, "hall": hall, "street": street, "slopes": slopes}
"""Scenes by name."""
