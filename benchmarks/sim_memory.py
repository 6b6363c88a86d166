"""What a sensor's buffers take, and what its steady loop allocates."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import warp as wp

__all__ = ["SteadyLoop", "buffer_bytes", "watch_steady_loop"]

WARM_STEPS = 5


@dataclass(frozen=True)
class SteadyLoop:
    """What was allocated in so many steps after warm-up.

    Attributes:
        steps: How many were watched.
        warp_allocations: Calls of Warp's allocators, on the device and the host.
        warp_bytes: What they asked for in all.
        python_kept_bytes: By how much the memory of Python and NumPy grew.
        python_peak_bytes: The most that was held for a moment: the objects of calls.
    """

    steps: int
    warp_allocations: int
    warp_bytes: int
    python_kept_bytes: int
    python_peak_bytes: int

    def __str__(self) -> str:
        return (
            f"{self.steps} steps after warm-up: {self.warp_bytes} bytes in "
            f"{self.warp_allocations} allocations of Warp; Python and NumPy grew by "
            f"{self.python_kept_bytes} bytes (for a moment by {self.python_peak_bytes:,})"
        )


def buffer_bytes(make: Callable[[], Any]) -> int:
    """Bytes that Warp's allocators hold of what is made: on the device, or the host for a CPU."""
    with wp.ScopedMemoryTracker("buffers", print=False):
        before = _counters().wp_alloc_tracker_get_current_bytes()
        made = make()
        held = _counters().wp_alloc_tracker_get_current_bytes() - before
        del made
    return int(held)


def watch_steady_loop(step: Callable[[], None], steps: int) -> SteadyLoop:
    """Count what steps allocate, once they are warm."""
    with wp.ScopedMemoryTracker("steady loop", print=False):
        for _ in range(WARM_STEPS):
            step()
        core = _counters()
        calls = core.wp_alloc_tracker_get_total_alloc_count()
        total = core.wp_alloc_tracker_get_total_alloc_bytes()
        for _ in range(steps):
            step()
        calls = core.wp_alloc_tracker_get_total_alloc_count() - calls
        total = core.wp_alloc_tracker_get_total_alloc_bytes() - total
    kept, peak = _python_bytes(step, steps)
    return SteadyLoop(steps, calls, total, kept, peak)


def _python_bytes(step: Callable[[], None], steps: int) -> tuple[int, int]:
    """Growth and momentary most of what Python and NumPy hold."""
    tracemalloc.start()
    try:
        for _ in range(WARM_STEPS):  # what Python itself keeps for later, and the tracing
            step()
        gc.collect()  # threads leave cycles of objects behind, which Python clears now and then
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        for _ in range(steps):
            step()
        _, peak = tracemalloc.get_traced_memory()
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return after - before, peak - before


def _counters() -> Any:
    # Warp prints these numbers in its tracker's report, but hands them out nowhere else.
    return wp._src.context.runtime.core
