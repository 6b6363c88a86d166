"""Threads: what a pool promises to those who share work in it."""

from __future__ import annotations

import os
import threading

import pytest

from depthwarp.threads import thread_pool


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="cores are not numbered here")
def test_threads_that_fill_all_cores_have_one_each():
    """So that none waits behind another; the caller, and fewer threads, go where there is room."""
    cores = os.sched_getaffinity(0)
    if len(cores) < 2:
        pytest.skip("one core")
    together = threading.Barrier(len(cores))

    def own_cores(_: int) -> frozenset[int]:
        together.wait(30)  # none takes the work of two
        return frozenset(os.sched_getaffinity(0))

    found = set(thread_pool(len(cores)).map(own_cores, range(len(cores))))
    assert found == {frozenset({core}) for core in cores}
    assert os.sched_getaffinity(0) == cores
    assert thread_pool(len(cores) - 1).submit(os.sched_getaffinity, 0).result() == cores
