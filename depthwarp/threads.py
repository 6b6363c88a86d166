"""Threads that are kept: the pools in which a CPU's work is shared."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache

__all__ = ["thread_pool"]


@cache
def thread_pool(threads: int) -> ThreadPoolExecutor:
    """The pool of so many threads, made on first use."""
    return ThreadPoolExecutor(threads, thread_name_prefix="depthwarp")


if hasattr(os, "register_at_fork"):  # a forked process has the pools, but none of their threads
    os.register_at_fork(after_in_child=thread_pool.cache_clear)
