"""depthwarp: depth maps from 3D point clouds, from any pose, on CPU and GPU with the same bits.

Frames: world is Z up; camera is X forward, Y left, Z up; images have pixel centres at whole
numbers. Units: metres, degrees, pixels. See `dw.render` to begin.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from depthwarp import cameras, errors, filters, io, sim
    from depthwarp.cameras import (
        Camera,
        CylindricalCamera,
        DoubleSphereCamera,
        EquirectangularCamera,
        FisheyeCamera,
        OrthographicCamera,
        PinholeCamera,
        Pose,
        SpinningLidar,
    )
    from depthwarp.cloud import PointCloud
    from depthwarp.depth_map import DepthMap, RenderStats, State
    from depthwarp.depth_maps import DepthMaps
    from depthwarp.io import read
    from depthwarp.prepared import PreparedCloud
    from depthwarp.range_view import RangeView
    from depthwarp.rendering import Renderer, render, render_batch, render_stream

__all__ = [
    "Camera",
    "CylindricalCamera",
    "DepthMap",
    "DepthMaps",
    "DoubleSphereCamera",
    "EquirectangularCamera",
    "FisheyeCamera",
    "OrthographicCamera",
    "PinholeCamera",
    "PointCloud",
    "Pose",
    "PreparedCloud",
    "RangeView",
    "RenderStats",
    "Renderer",
    "SpinningLidar",
    "State",
    "cameras",
    "errors",
    "filters",
    "io",
    "read",
    "render",
    "render_batch",
    "render_stream",
    "sim",
]

__version__ = "0.1.0"

# Imported on first use: `import depthwarp` and `depthwarp --help` do not wait for Warp or OpenCV.
_MODULE_OF_NAME = {
    "Camera": "depthwarp.cameras",
    "CylindricalCamera": "depthwarp.cameras",
    "DepthMap": "depthwarp.depth_map",
    "DepthMaps": "depthwarp.depth_maps",
    "DoubleSphereCamera": "depthwarp.cameras",
    "EquirectangularCamera": "depthwarp.cameras",
    "FisheyeCamera": "depthwarp.cameras",
    "OrthographicCamera": "depthwarp.cameras",
    "PinholeCamera": "depthwarp.cameras",
    "PointCloud": "depthwarp.cloud",
    "Pose": "depthwarp.cameras",
    "PreparedCloud": "depthwarp.prepared",
    "RangeView": "depthwarp.range_view",
    "RenderStats": "depthwarp.depth_map",
    "Renderer": "depthwarp.rendering",
    "SpinningLidar": "depthwarp.cameras",
    "State": "depthwarp.depth_map",
    "read": "depthwarp.io",
    "render": "depthwarp.rendering",
    "render_batch": "depthwarp.rendering",
    "render_stream": "depthwarp.rendering",
}
_SUBMODULES = frozenset({"cameras", "errors", "filters", "io", "sim"})


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name in _SUBMODULES:
        return importlib.import_module(f"depthwarp.{name}")
    if name in _MODULE_OF_NAME:
        value = getattr(importlib.import_module(_MODULE_OF_NAME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'depthwarp' has no attribute '{name}'")


def __dir__() -> list[str]:
    """The public names."""
    return sorted([*__all__, "__version__"])
