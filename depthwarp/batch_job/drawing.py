"""Drawing the views that are missing, while those before them are written."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from depthwarp.batch_job.outputs import Output
from depthwarp.batch_job.views import Views
from depthwarp.depth_map import DepthMap
from depthwarp.errors import CapacityError
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.plan import MAP_BYTES, RenderPlan
from depthwarp.rendering.views import ViewPlan

__all__ = ["draw_batch"]

TILE_BYTES, TILE_VIEWS = 1 << 26, 128
"""Most bytes of maps, and most views, that are drawn together: a kill costs at most two tiles."""


def draw_batch(
    cloud: PreparedCloud,
    output: Output,
    config: RenderConfig,
    *,
    wrote: Callable[[Sequence[DepthMap]], None] = lambda maps: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Draw and write the views that an output lacks.

    One tile of views is drawn while the one before is written, so at most two are in memory. Each
    map is, bit for bit, what `render` gives for its view alone.

    Args:
        cloud: The cloud, on the device where it is drawn.
        output: Where to write, after its `begin`.
        config: Depth kind, bounds and filters.
        wrote: Called with the maps of each tile that has been written, in another thread.
        is_stopped: Asked before each tile; where it is true, what is drawn is written and the rest
            left.

    Raises:
        InputError: A camera without the kind of depth, or an output that cannot be written.
        CapacityError: A view does not fit the device's memory.
    """
    plan: RenderPlan | None = None
    key, count = -1, 0
    with ThreadPoolExecutor(1) as writer:
        writing: Future[None] | None = None
        for group, numbers in _tiles(output.views, output.work.done):
            if is_stopped():
                break
            views = [ViewPlan(output.views.camera(number)) for number in numbers]
            if plan is not None and (key, count) == (group, len(numbers)):
                plan.look_from(views)
            else:
                plan = None  # its buffers are let go before there are others
                plan = _plan(views, config, cloud)
                key, count = group, len(numbers)
            plan.render(cloud)
            maps = plan.depth_maps()
            if writing is not None:
                writing.result()  # the writer's error, if it met one
            writing = writer.submit(output.write, numbers, maps, wrote)
        if writing is not None:
            writing.result()


def _plan(views: Sequence[ViewPlan], config: RenderConfig, cloud: PreparedCloud) -> RenderPlan:
    """A plan; if it does not fit the memory, with what to do about it in a batch."""
    try:
        return RenderPlan(views, config, cloud.device)
    except CapacityError as error:
        needed = str(error).rpartition(": ")[0]
        raise CapacityError(
            f"{needed}: give a smaller size, with --size or in the file of the lens"
        ) from error


def _tiles(views: Views, done: np.ndarray) -> Iterator[tuple[int, list[int]]]:
    """Numbers of missing views that one plan can draw together, and the number of the plan."""
    lenses = [lens.device_lens() for lens in views.lenses]
    keys = [
        (lens.model, camera.size, len(lens.table))
        for lens, camera in zip(lenses, views.lenses, strict=True)
    ]
    different = list(dict.fromkeys(keys))
    group_of_lens = np.array([different.index(key) for key in keys])
    missing = np.flatnonzero(~done)
    groups = group_of_lens[views.lens_of[missing]]
    for group, (_, (width, height), _) in enumerate(different):
        numbers = missing[groups == group].tolist()
        most = min(TILE_VIEWS, max(1, TILE_BYTES // (MAP_BYTES * width * height)))
        for first in range(0, len(numbers), most):
            yield group, numbers[first : first + most]
