"""Threads: what a pool and its helpers promise to those who share work."""

from __future__ import annotations

import os
import threading
import time

import pytest

from depthwarp.threads import Shared, pieces_of, share, thread_pool


def test_every_thread_does_its_work_and_is_waited_for():
    """Results in the order of the threads' numbers; one thread is the caller itself."""
    assert share(lambda thread: 10 * thread, 3) == [0, 10, 20]
    assert share(lambda _: threading.get_ident(), 1) == [threading.get_ident()]


def test_an_error_reaches_the_caller_when_all_are_done():
    """Whichever thread it happens in; none goes on working behind the caller's back."""
    ended = []

    def work(thread: int) -> None:
        if thread == 0:
            raise ZeroDivisionError
        time.sleep(0.1)
        ended.append(thread)

    with pytest.raises(ZeroDivisionError):
        share(work, 2)
    assert ended == [1]


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


def test_shared_items_are_taken_once():
    """Seven threads take from one iterator."""
    items = Shared(range(1000))
    taken = share(lambda _: list(items), 7)
    assert sorted(item for items in taken for item in items) == list(range(1000))


@pytest.mark.parametrize(("count", "most"), [(0, 3), (2, 5), (10, 3), (7, 1)])
def test_pieces_cover_everything_once(count, most):
    """No piece is empty, and sizes differ by one at most."""
    pieces = pieces_of(count, most)
    assert [i for first, end in pieces for i in range(first, end)] == list(range(count))
    assert len(pieces) == min(count, most)
    assert len({end - first for first, end in pieces}) <= 2
