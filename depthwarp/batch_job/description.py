"""What a batch is: all that decides the content of its files, and how to read them."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

import depthwarp
from depthwarp.batch_job.views import Views, lens_to_dict
from depthwarp.cloud import PointCloud
from depthwarp.encodings import Encoding
from depthwarp.errors import FileFormatError
from depthwarp.rendering.config import RenderConfig

__all__ = ["describe_batch", "differences", "read_description"]

WORDS = {
    "version": "depthwarp",
    "views": "number of views",
    "depth_kind": "--depth",
    "min_range_m": "--min-range",
    "max_range_m": "--max-range",
    "filters": "--filters",
    "encoding": "--encoding",
    "lenses": "the lens",
    "poses": "the poses",
    "cloud": "the cloud",
}
"""What a person calls the entries that can differ."""


def describe_batch(
    cloud: PointCloud, views: Views, config: RenderConfig, encoding: Encoding | None
) -> dict[str, Any]:
    """The description, as JSON values.

    Args:
        cloud: The points, as they are drawn.
        views: The views.
        config: Depth kind, bounds and filters.
        encoding: Of 16-bit images; None for float32 metres.
    """
    points = np.ascontiguousarray(cloud.points_world)
    description = {
        "format": "depthwarp batch",
        "version": depthwarp.__version__,
        "views": len(views),
        "empty_value": 0,
        "depth_kind": config.depth,
        "min_range_m": config.min_range,
        # JSON has no infinity: null is "no bound".
        "max_range_m": config.max_range if math.isfinite(config.max_range) else None,
        "filters": [repr(step) for step in config.filters],
        **_meaning(encoding),
        "cloud": {
            "points": len(cloud),
            "blake2b": hashlib.blake2b(points.data, digest_size=16).hexdigest(),
        },
        "poses": {"blake2b": views.poses_hash()},
        "lenses": [lens_to_dict(lens) for lens in views.lenses],
    }
    values: dict[str, Any] = json.loads(json.dumps(description))  # as it will be read again
    return values


def read_description(text: str | bytes, path: Path) -> dict[str, Any]:
    """What a batch says of itself.

    Raises:
        FileFormatError: The text is not such a description.
    """
    try:
        description = json.loads(text)
        if description["format"] != "depthwarp batch":
            raise ValueError("it is of another format")
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise FileFormatError(
            f"{path} does not describe a batch ({error}): choose another output"
        ) from error
    return dict(description)


def differences(there: dict[str, Any], here: dict[str, Any]) -> list[str]:
    """What differs between two descriptions, in words."""
    different = [
        f"{word} {_said(key, there.get(key), here.get(key))}"
        for key, word in WORDS.items()
        if there.get(key) != here.get(key)
    ]
    return different if different or there == here else ["the description differs"]


def _said(key: str, there: Any, here: Any) -> str:
    """How two values of an entry differ."""
    if key == "cloud" and isinstance(there, dict) and there.get("points") != here["points"]:
        return f"has {here['points']} points, it had {there.get('points')}"
    if key in ("cloud", "poses", "lenses"):
        return "is another" if key != "poses" else "are others"
    if key == "filters":
        there, here = (" ".join(filters or ()) or "none" for filters in (there, here))
    old, new = ("inf" if value is None else value for value in (there, here))
    return f"is {new}, it was {old}"


def _meaning(encoding: Encoding | None) -> dict[str, Any]:
    """How numbers become metres."""
    if encoding is None:
        return {
            "encoding": "metres",
            "dtype": "float32",
            "depth_m": "value",
            "metres_per_unit": 1.0,
        }
    divisor = "" if encoding.divisor == 1 else f" * {encoding.divisor:g}"
    return {
        "encoding": encoding.name,
        "dtype": "uint16",
        "depth_m": f"value / {encoding.factor:g}{divisor}",
        "metres_per_unit": encoding.divisor / encoding.factor,
    }
