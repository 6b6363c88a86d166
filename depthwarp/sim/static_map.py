"""Points that all worlds share."""

from __future__ import annotations

from typing import Any

from depthwarp.cloud import PointCloud
from depthwarp.errors import InputError
from depthwarp.prepared import PreparedCloud

__all__ = ["prepared_map"]


def prepared_map(cloud: PointCloud | PreparedCloud | None, device: Any) -> PreparedCloud | None:
    """A static map in the order in which views can skip what they do not see.

    Raises:
        InputError: Not a cloud, or one that was prepared on another device.
    """
    if cloud is None:
        return None
    if isinstance(cloud, PointCloud):
        return cloud.prepare(device=device.alias)
    if not isinstance(cloud, PreparedCloud):
        raise InputError(
            f"static_map must be a PointCloud or a PreparedCloud, got {type(cloud).__name__}"
        )
    if cloud.device != device:
        raise InputError(
            f"static_map was prepared on {cloud.device.alias}, the sensor is on {device.alias}"
        )
    return cloud
