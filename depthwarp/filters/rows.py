"""Launches over the rows of all views: one on CUDA, parts on all cores of a CPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from depthwarp.devices import usable_cores
from depthwarp.filters.maps import DeviceMaps
from depthwarp.threads import Shared, share

__all__ = ["row_launch"]

PARTS_A_THREAD = 8
"""Parts that a thread takes one after the other, so that none waits long for the last."""

LEAST_PIXELS = 1 << 13
"""Pixels of a part below which a thread costs more than it saves."""


def row_launch(
    kernel: Any,
    maps: DeviceMaps,
    inputs: Sequence[Any],
    outputs: Sequence[Any],
    size: tuple[int, int] | None = None,
) -> Callable[[], None]:
    """A launch that is prepared now and run as often as wanted.

    Every pixel is computed by itself, so the result does not depend on how rows are shared.

    Args:
        kernel: A kernel over (rows, columns), whose first argument is the number of the first row;
            rows of all views are counted on.
        maps: What says how many views there are, where, and on how many threads.
        inputs: Its arguments after the first row.
        outputs: What it writes.
        size: (rows, columns) of a view that it runs over; those of the maps when None.
    """
    device = maps.depth.device
    threads = usable_cores() if maps.threads is None else maps.threads
    views, *image = maps.depth.shape
    pixels = views * image[0] * image[1]
    rows, columns = image if size is None else size
    rows *= views
    count = 1
    if not device.is_cuda:
        most = max(pixels // LEAST_PIXELS, 1)
        count = 1 if threads == 1 else min(threads * PARTS_A_THREAD, most, rows)
    firsts = [rows * part // count for part in range(count + 1)]
    commands: list[Any] = [
        wp.launch(
            kernel,
            dim=(last - first, columns),
            inputs=[first, *inputs],
            outputs=list(outputs),
            device=device,
            record_cmd=True,
        )
        for first, last in zip(firsts[:-1], firsts[1:], strict=True)
    ]
    if count == 1:
        only: Callable[[], None] = commands[0].launch
        return only

    def launch() -> None:
        if device.is_capturing:  # a graph takes what the thread launches that began it
            for command in commands:
                command.launch()
            return
        left = Shared(commands)

        def work(_thread: int) -> None:
            for command in left:
                command.launch()

        share(work, threads)

    return launch
