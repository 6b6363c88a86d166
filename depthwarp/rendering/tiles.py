"""Any number of views, drawn in tiles: memory for one tile, whose buffers are used again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.cloud import PointCloud
from depthwarp.depth_map import DepthMap
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_points
from depthwarp.rendering.plan import MAP_BYTES, RenderPlan
from depthwarp.rendering.ragged import OUTPUTS, RaggedPlan
from depthwarp.rendering.views import ViewPlan

__all__ = ["Look", "draw_looks"]

TILE_BYTES = 1 << 26
"""Buffers of the views that are drawn together, and their clouds but the first [bytes]."""

SMALL_CLOUD = 100_000
"""Most points of a cloud that is drawn together with others: above, a view is work enough for all
cores, and a copy of the points beside those of others is not free."""


MANY_VIEWS = 16
"""Fewest views of small clouds for which drawing them together pays."""


@dataclass(frozen=True, eq=False)
class Look:
    """One view of one cloud.

    Attributes:
        cloud: What is seen.
        view: Through which camera.
    """

    cloud: PointCloud | PreparedCloud
    view: ViewPlan

    @cached_property
    def kind(self) -> tuple[Any, ...]:
        """What views of one plan have in common."""
        lens = self.view.lens
        ranged = self.view.line_count > 0
        return self.is_small, lens.model, self.view.camera.size, len(lens.table), ranged

    @property
    def is_small(self) -> bool:
        """Whether the cloud is drawn together with others."""
        return isinstance(self.cloud, PointCloud) and len(self.cloud) <= SMALL_CLOUD

    @property
    def group(self) -> tuple[Any, ...]:
        """What views that are drawn in one call have in common: a plan, and a cloud if large."""
        return *self.kind, 0 if self.is_small else id(self.cloud)


def draw_looks(looks: Iterable[Look], config: RenderConfig, device: Any) -> Iterator[DepthMap]:
    """The depth maps of views, in order; each is what `render` gives for its view alone.

    Views are taken from the iterable a tile at a time, when the maps before have been taken.

    Raises:
        InputError: A view that cannot be drawn; the maps of its tile are lost.
        CapacityError: A view does not fit the device's memory.
    """
    plans = _Plans(config, device)
    for tile in _tiles(looks):
        plans.keep({look.kind for look in tile})
        maps: dict[int, DepthMap] = {}
        for numbers in _groups(tile):
            drawn = plans.draw([tile[number] for number in numbers])
            maps.update(zip(numbers, drawn, strict=True))
        for number in range(len(tile)):
            yield maps.pop(number)  # not kept here: the caller may let it go


def _tiles(looks: Iterable[Look]) -> Iterator[list[Look]]:
    """Views in groups whose buffers stay small, as do all clouds of a group but its first."""
    tile: list[Look] = []
    clouds: set[int] = set()
    held = 0
    for look in looks:
        width, height = look.view.camera.size
        needed = MAP_BYTES * width * height
        if tile and id(look.cloud) not in clouds:
            needed += 12 * len(look.cloud)
        if tile and held + needed > TILE_BYTES:
            yield tile
            tile, clouds, held = [], set(), 0
        tile.append(look)
        clouds.add(id(look.cloud))
        held += needed
    if tile:
        yield tile


def _groups(tile: Sequence[Look]) -> Iterator[list[int]]:
    """Numbers of views that are drawn in one call: many of small clouds, or all of one cloud."""
    groups: dict[Any, list[int]] = {}
    for number, look in enumerate(tile):
        groups.setdefault(look.group, []).append(number)
    for numbers in groups.values():
        if len(numbers) >= MANY_VIEWS:
            yield numbers
            continue
        of_cloud: dict[int, list[int]] = {}
        for number in numbers:
            of_cloud.setdefault(id(tile[number].cloud), []).append(number)
        yield from of_cloud.values()


class _Plans:
    """Plans of the last tile, used again by views of the same kind."""

    def __init__(self, config: RenderConfig, device: Any) -> None:
        self._config, self._device = config, device
        self._many: dict[Any, tuple[RaggedPlan, int]] = {}
        self._one: dict[Any, tuple[RenderPlan, int]] = {}
        self._points: tuple[Any, Any] = (None, None)

    def keep(self, kinds: set[Any]) -> None:
        """Let go of the plans of other kinds of views."""
        self._many = {kind: plan for kind, plan in self._many.items() if kind in kinds}
        self._one = {kind: plan for kind, plan in self._one.items() if kind in kinds}

    def draw(self, looks: Sequence[Look]) -> list[DepthMap]:
        """The maps of views of one group."""
        if looks[0].is_small and len(looks) >= MANY_VIEWS:
            return self._draw_small(looks)
        plan, cloud = self._plan_of_one(looks), looks[0].cloud
        if self._points[0] is not cloud:
            self._points = cloud, device_points(cloud, self._device)
        plan.render(self._points[1])
        return plan.depth_maps()

    def _plan_of_one(self, looks: Sequence[Look]) -> RenderPlan:
        """A plan for as many views of a large cloud."""
        kind, views = looks[0].kind, [look.view for look in looks]
        plan, count = self._one.pop(kind, (None, 0))
        if plan is not None and count == len(views):
            plan.look_from(views)
        else:
            plan = None  # its buffers are let go before there are others
            plan = RenderPlan(views, self._config, self._device)
        self._one[kind] = plan, len(views)
        return plan

    def _draw_small(self, looks: Sequence[Look]) -> list[DepthMap]:
        """The maps of views of small clouds, each cloud copied once beside the others."""
        plan = self._plan_of_many(looks)
        clouds: dict[int, Any] = {id(look.cloud): look.cloud for look in looks}
        rows = {cloud: row for row, cloud in enumerate(clouds)}
        points = [cloud.points_world for cloud in clouds.values()]
        offsets = np.cumsum([0, *map(len, points)], dtype=np.int32)
        cloud_of = np.array([rows[id(look.cloud)] for look in looks], dtype=np.int32)
        plan.render(
            arrays.share_points(np.concatenate(points), self._device),
            arrays.share(offsets, wp.int32, self._device),
            arrays.share(cloud_of, wp.int32, self._device),
            len(looks),
        )
        return plan.depth_maps(len(looks))

    def _plan_of_many(self, looks: Sequence[Look]) -> RaggedPlan:
        """A plan for at least as many views of small clouds."""
        kind, views = looks[0].kind, [look.view for look in looks]
        plan, count = self._many.pop(kind, (None, 0))
        if plan is not None and count >= len(views):
            plan.look_from(views + views[-1:] * (count - len(views)))
        else:
            plan, count = None, len(views)
            plan = RaggedPlan(views, self._config, tuple(OUTPUTS), self._device)
        self._many[kind] = plan, count
        return plan
