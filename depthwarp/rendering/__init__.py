"""Rendering: clouds into depth maps."""

from depthwarp.rendering.batch import render_batch
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.plan import RenderPlan
from depthwarp.rendering.renderer import Renderer
from depthwarp.rendering.single import render
from depthwarp.rendering.stream import render_stream
from depthwarp.rendering.views import ViewPlan

__all__ = [
    "RenderConfig",
    "RenderPlan",
    "Renderer",
    "ViewPlan",
    "render",
    "render_batch",
    "render_stream",
]
