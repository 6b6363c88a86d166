"""The SDK's emulated camera, and the pictures that it shows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.scanner.sources import BaslerSource
from tests.scanner.sources.pictures import colourful

WIDTH, HEIGHT = 61, 40

Open = Callable[..., BaslerSource]


@pytest.fixture
def pylon(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The SDK with one emulated camera."""
    reason = "pypylon is not installed: pip install pypylon runs the camera tests in emulation"
    module = pytest.importorskip("pypylon.pylon", reason=reason)
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    return module


@pytest.fixture
def pictures(tmp_path: Path) -> list[npt.NDArray[np.uint8]]:
    """Three pictures, which lie as PNG files in the folder that the camera shows."""
    images = [colourful(WIDTH, HEIGHT, seed) for seed in range(3)]
    for index, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"f{index:03d}.png"), image)
    return images


@pytest.fixture
def camera(pylon: Any, pictures: list[npt.NDArray[np.uint8]], tmp_path: Path) -> Any:
    """Makes sources of the emulated camera, set to show the pictures; closes them in the end."""
    made: list[BaslerSource] = []

    def make(serial: str | None = None, **options: Any) -> BaslerSource:
        features = {
            "Width": WIDTH,
            "Height": HEIGHT,
            "TestImageSelector": "Off",
            "ImageFileMode": "On",
            "ImageFilename": str(tmp_path),
        } | options.pop("features", {})
        made.append(BaslerSource(serial, features=features, **options))
        return made[-1]

    yield make
    for source in made:
        source.close()
