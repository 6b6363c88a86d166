"""Running the program as a user does, and small files to run it on."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from depthwarp.cli.main import app

Run = Callable[..., Result]

VIEW = "--position 0 0 0 --orientation 0 0 0 --fov 60 60 --size 64 48".split()


def invoke(*arguments: object) -> Result:
    """Run a command in this process: `invoke("info", path)`."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def run() -> Run:
    """`invoke`, as a fixture."""
    return invoke


@pytest.fixture
def run_program() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the program in a process of its own, as a shell would."""

    def invoke(
        *arguments: object, python: tuple[str, ...] = ()
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, *python, "-m", "depthwarp", *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=120,
            stdin=subprocess.DEVNULL,
        )

    return invoke


@pytest.fixture
def wall_points() -> np.ndarray:
    """A wall 4 m ahead of the origin, facing it, shape (N, 3)."""
    y, z = np.meshgrid(np.linspace(-2, 2, 80), np.linspace(-2, 2, 80))
    return np.stack([np.full(y.size, 4.0), y.ravel(), z.ravel()], axis=1).astype(np.float32)


@pytest.fixture
def wall(tmp_path: Path, wall_points: np.ndarray) -> Path:
    """The wall as an XYZ file, written by hand."""
    path = tmp_path / "wall.xyz"
    path.write_text("".join(f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in wall_points))
    return path
