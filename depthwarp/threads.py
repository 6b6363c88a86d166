"""Threads that are kept: the pools in which a CPU's work is shared."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from functools import cache
from itertools import cycle
from typing import Any, TypeVar

__all__ = ["Shared", "pieces_of", "share", "thread_pool"]

Result = TypeVar("Result")


@cache
def thread_pool(threads: int) -> ThreadPoolExecutor:
    """The pool of so many threads, made on first use; where they fill all cores, one on each.

    Linux often starts a thread that was asleep on the core of the one that wakes it, above all in a
    virtual machine, which cannot tell a core that rests from one that was taken away. There both
    would take turns for milliseconds, which is all the time that a view takes. What such a thread
    starts, a thread or a process, stays on its core too: they are for launches alone.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) < 2 or threads < len(cores):
        return ThreadPoolExecutor(threads, thread_name_prefix="depthwarp")
    core_of_thread = cycle(cores)

    def settle() -> None:
        with suppress(OSError):  # a core that was taken from the process meanwhile
            os.sched_setaffinity(0, {next(core_of_thread)})

    return ThreadPoolExecutor(threads, thread_name_prefix="depthwarp", initializer=settle)


def share(work: Callable[[int], Result], threads: int) -> list[Result]:
    """Let every thread do its work, and wait for all of them, also where one fails.

    Returns:
        What `work` returns for 0, 1, ..., `threads` - 1.
    """
    if threads == 1:
        return [work(0)]
    pool = thread_pool(threads)
    jobs = [pool.submit(work, thread) for thread in range(threads)]
    wait(jobs)
    return [job.result() for job in jobs]


class Shared:
    """An iterator from which several threads take."""

    def __init__(self, items: Iterable[Any]) -> None:
        self._items, self._lock = iter(items), threading.Lock()

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> Any:
        with self._lock:
            return next(self._items)


def pieces_of(count: int, most: int) -> list[tuple[int, int]]:
    """From 0 to `count` in at most so many pieces of nearly one size: first, and end."""
    bounds = [count * piece // most for piece in range(most + 1)]
    return [(first, end) for first, end in zip(bounds, bounds[1:], strict=False) if end > first]


if hasattr(os, "register_at_fork"):  # a forked process has the pools, but none of their threads
    os.register_at_fork(after_in_child=thread_pool.cache_clear)
