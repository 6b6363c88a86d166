"""Compute devices: their names, what is free on them."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import warp as wp

from depthwarp.errors import CapacityError, DeviceError

__all__ = ["check_memory", "free_memory", "resolve_device", "usable_cores"]

# A library does not write to its caller's stdout: Warp's greeting and its compile messages stay
# away unless the program asks for them (wp.config.log_level, set after this import). On machines
# without a GPU one line of its native code remains: it goes straight to the process's stderr, which
# a library must not redirect, since other threads write there too.
if wp.config.log_level == wp.LOG_INFO:
    wp.config.log_level = wp.LOG_WARNING


def resolve_device(name: str | None) -> Any:
    """The Warp device of a name such as `"cpu"` or `"cuda:0"`; None is Warp's default device.

    Raises:
        DeviceError: There is no such device; the message lists those that there are.
    """
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise DeviceError(f"device '{name}' is not on this machine: use one of {known}") from error


def usable_cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def free_memory(device: Any) -> int:
    """Bytes that can be allocated on a device now, to the best of the system's knowledge."""
    if device.is_cuda:
        return int(device.free_memory)
    free = _free_system_memory()
    limit, used = Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")
    try:
        return min(free, int(limit.read_text()) - int(used.read_text()))
    except (OSError, ValueError):  # no container limit: no such file, or the word "max"
        return free


def _free_system_memory() -> int:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:  # not Linux: the whole memory is the best bound that there is
        pass
    if hasattr(os, "sysconf"):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return sys.maxsize


def check_memory(what: str, needed: int, device: Any, remedy: str) -> None:
    """Refuse a request that would not fit, before anything is allocated.

    Raises:
        CapacityError: `needed` bytes are more than are free on the device.
    """
    free = free_memory(device)
    if needed > free:
        raise CapacityError(
            f"{what} needs {needed / 1e9:.3g} GB on {device.alias}, "
            f"{free / 1e9:.3g} GB are free: {remedy}"
        )
