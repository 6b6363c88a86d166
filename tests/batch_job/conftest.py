"""A small cloud, a walk round in it, and the program that draws it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.batch_job import drawing

TILE = 16
LENS = ("--fov", "70", "55", "--size", "16", "12")


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """Points on the walls of a room, one of them not finite, as an NPZ."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (4000, 3)).astype(np.float32)
    rows = np.arange(len(points))
    points[rows, rng.integers(0, 3, len(points))] = rng.choice([-1.0, 1.0], len(points))
    points[7] = np.nan
    path = tmp_path / "room.npz"
    np.savez(path, points=points * np.float32(3))
    return path


@pytest.fixture
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most `TILE` views are drawn at once, in this process."""
    monkeypatch.setattr(drawing, "TILE_VIEWS", TILE)


def walk(count: int) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Positions [m] and orientations [degrees] round the room."""
    return [
        ((math.cos(0.3 * k), math.sin(0.3 * k), 0.1 * (k % 5)), (k % 7, 3 - k % 6, 37.0 * k))
        for k in range(count)
    ]


def write_csv(path: Path, count: int) -> Path:
    """The walk as a CSV."""
    rows = [",".join(map(repr, (*place, *turn))) for place, turn in walk(count)]
    path.write_text("x,y,z,roll,pitch,yaw\n" + "".join(f"{row}\n" for row in rows))
    return path


def cameras(count: int) -> list[dw.PinholeCamera]:
    """The walk as cameras of `LENS`."""
    return [
        dw.PinholeCamera.from_fov((70, 55), (16, 12), place, turn) for place, turn in walk(count)
    ]


def content(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
