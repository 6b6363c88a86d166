"""Peak memory of a peer: in a process of its own, beyond the inputs that are loaded in it."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import warp as wp

import depthwarp as dw
from benchmarks.peers import PEERS, Float32Array
from depthwarp.cli.report import quiet_warp

__all__ = ["memory_beside", "peak_memory"]

FIRST_POINTS = 1000
FIRST_SIZE = (64, 48)


def peak_memory(
    name: str,
    device: str,
    points_world: Float32Array,
    cameras: Sequence[dw.PinholeCamera],
    max_range: float,
) -> int:
    """Bytes by which a peer's preparation and one run grow a process that holds the points."""
    return memory_beside(_prepare_and_run, points_world, name, device, tuple(cameras), max_range)


def memory_beside(work: Callable[..., None], points_world: Float32Array, *arguments: Any) -> int:
    """Bytes by which work on points grows a process of its own that holds the points.

    Libraries are loaded and kernels compiled before, by the same work on a few points and a small
    image; what is counted afterwards is the highest resident memory less that before the work.

    Args:
        work: A function of a module, called with the points, whether this is the first small run,
            and the arguments.
        points_world: Points [m], shape (N, 3).
        arguments: The others that `work` takes; they must pickle.
    """
    with TemporaryDirectory() as folder:
        file = Path(folder) / "points.npy"
        np.save(file, points_world)
        start = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=start) as process:
            cache = str(wp.config.kernel_cache_dir)
            return process.submit(_growth, work, file, cache, arguments).result()


def small(camera: dw.PinholeCamera) -> dw.PinholeCamera:
    """The camera with next to no pixels."""
    width, height = FIRST_SIZE
    return replace(camera, width=width, height=height)


def _prepare_and_run(
    points_world: Float32Array,
    is_first: bool,
    name: str,
    device: str,
    cameras: Sequence[dw.PinholeCamera],
    max_range: float,
) -> None:
    peer = PEERS[name](device)
    peer.prepare(
        points_world, [small(camera) for camera in cameras] if is_first else cameras, max_range
    )
    peer.run()


def _growth(work: Callable[..., None], file: Path, cache: str, arguments: Any) -> int:
    wp.config.kernel_cache_dir = cache
    quiet_warp()
    points_world = np.load(file)
    work(points_world[:FIRST_POINTS].copy(), True, *arguments)
    before = _resident_bytes("VmRSS")
    work(points_world, False, *arguments)
    return _resident_bytes("VmHWM") - before


def _resident_bytes(field: str) -> int:
    """Resident memory now (`VmRSS`) or at its highest (`VmHWM`).

    Linux hands `ru_maxrss` of the process that started this one on to it, so it is only taken
    where there is no /proc, where it is the highest for both.
    """
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        import resource  # not on Windows

        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{field}:"))
