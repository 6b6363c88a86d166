"""Clouds prepared for many views: in spatial order, in blocks, exact or quantized."""

from depthwarp.prepared.cloud import PreparedCloud

__all__ = ["PreparedCloud"]
