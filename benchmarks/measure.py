"""Measuring: alternating runs, their times, the machine, and how fast it reads memory."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp

import depthwarp
from depthwarp.devices import usable_cores

__all__ = ["Timing", "alternate", "machine", "read_bandwidth", "run_once"]

PAUSE_S = 0.05
"""Before each run: the worker threads of the peer that ran last go on spinning for a while."""

WARM_S = 0.02
"""Of untimed runs before each timed one, at least one: in a pause caches cool and cores sleep."""

READ_BYTES = 512 * 2**20
READ_REPEATS = 7


@dataclass(frozen=True)
class Timing:
    """Repeated runs of one thing: seconds of wall clock and of processor time, one a run."""

    wall_s: tuple[float, ...]
    processor_s: tuple[float, ...]

    def per_second(self, amount: float) -> tuple[float, float, float]:
        """Lower quartile, median and upper quartile of `amount` a second."""
        slow, middle, fast = np.percentile(self.wall_s, (75, 50, 25))
        return float(amount / slow), float(amount / middle), float(amount / fast)

    def times_as_fast_as(self, other: Timing) -> float:
        """Median over the rounds of the other's time over this one's; both ran in turn."""
        return float(np.median(np.divide(other.wall_s, self.wall_s)))

    @property
    def busy_cores(self) -> float:
        """Processor time over wall time: how many cores were busy, threads that spin included."""
        return sum(self.processor_s) / sum(self.wall_s)


def run_once(run: Callable[[], None]) -> tuple[float, float]:
    """Wall and processor seconds of one run."""
    wall, processor = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - wall, time.process_time() - processor


def alternate(runs: Sequence[Callable[[], None]], repeats: int) -> list[Timing]:
    """Time all runs in turn, A B C A B C ..., so that a slow spell of the machine meets them all.

    Each run is one in a loop: right before it the same thing runs untimed. It has to return only
    when its work is done.
    """
    times: list[list[tuple[float, float]]] = [[] for _ in runs]
    for _ in range(repeats):
        for run, own in zip(runs, times, strict=True):
            time.sleep(PAUSE_S)
            _warm(run)
            own.append(run_once(run))
    return [Timing(*zip(*own, strict=True)) for own in times]


def _warm(run: Callable[[], None]) -> None:
    """Run untimed, once or until `WARM_S` have gone by."""
    end = time.perf_counter() + WARM_S
    run()
    while time.perf_counter() < end:
        run()


def read_bandwidth(threads: int = 1) -> float:
    """Bytes a second that so many threads read from memory: the best of several sums of an array.

    The array is 512 MiB of int64, far beyond the caches, and each thread sums a part of its own;
    NumPy sums integers with vector instructions, so that memory is what it waits for.
    """
    parts = np.array_split(np.ones(READ_BYTES // 8, dtype=np.int64), threads)
    with ThreadPoolExecutor(threads) as pool:

        def read() -> None:
            list(pool.map(np.sum, parts))

        return READ_BYTES / min(run_once(read)[0] for _ in range(READ_REPEATS))


def machine() -> dict[str, object]:
    """Processor, cores and versions: what a figure depends on besides the code."""
    return {
        "processor": _processor(),
        "cores": usable_cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "warp": wp.__version__,
        "depthwarp": depthwarp.__version__,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
