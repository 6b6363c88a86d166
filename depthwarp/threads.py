"""Threads that are kept: the pools in which a CPU's work is shared."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from itertools import cycle

__all__ = ["thread_pool"]


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


if hasattr(os, "register_at_fork"):  # a forked process has the pools, but none of their threads
    os.register_at_fork(after_in_child=thread_pool.cache_clear)
