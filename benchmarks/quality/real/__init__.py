"""The same scores on real recordings, found beside the project."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.quality.evaluate import Shot
from benchmarks.quality.real.lidar import kitti, ouster
from benchmarks.quality.real.rgbd import living_room, noisy_and_clean

__all__ = ["DATA", "real_cases"]

DATA = Path(__file__).resolve().parents[3].parent / "shared" / "data"
"""Where the recordings are looked for: `shared/data` beside the project."""

_SETS = {
    "living room, novel view": ("rgbd_livingroom/frames.json", living_room),
    "noisy and clean frame": ("rgbd_noisy_vs_clean/frames.json", noisy_and_clean),
    "Ouster, half the pixels": ("ouster/os0_128_street.npz", ouster),
    "KITTI, three of four points": ("kitti/testing_000007.bin", kitti),
}


def real_cases(
    data: Path, say: Callable[[str], None], device: str = "cpu"
) -> Iterator[tuple[str, list[Shot]]]:
    """Each recording's name and its views.

    Args:
        data: Folder of the recordings.
        say: Told which recordings are left out.
        device: Where the clouds are rendered.
    """
    for name, (marker, load) in _SETS.items():
        if (data / marker).is_file():
            yield name, load(data, device)
        else:
            say(f"{name} is left out: there is no file {data / marker}")
