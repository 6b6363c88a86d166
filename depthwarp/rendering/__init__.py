"""Rendering: clouds into depth maps."""

from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.plan import RenderPlan, ViewPlan
from depthwarp.rendering.single import render

__all__ = ["RenderConfig", "RenderPlan", "ViewPlan", "render"]
