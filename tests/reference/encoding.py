"""The 16-bit depth image of section 3.4: the full scale is the maximal range."""

from __future__ import annotations

import numpy as np

from .precision import rounded


def encode_range16(depth: np.ndarray, max_range: float) -> np.ndarray:
    """I = round(depth / max_range * 65535), ties to even, in float64, in this order; uint16.

    Empty (depth 0) is 0; a pixel that is not empty but would round to 0 becomes 1; a depth beyond
    the maximal range (both compared as float32) is dropped to 0, as the renderer drops it.
    """
    depth = np.asarray(depth, dtype=np.float32)
    value = np.rint(depth.astype(np.float64) / float(max_range) * 65535.0)
    value[(depth > 0) & (value == 0)] = 1
    value[depth > rounded(max_range, np.float32)] = 0
    return value.astype(np.uint16)


def decode_range16(image: np.ndarray, max_range: float) -> np.ndarray:
    """Depth of a 16-bit image: image / 65535 * max_range in float64, then float32; 0 stays 0."""
    return (np.asarray(image, dtype=np.float64) / 65535.0 * float(max_range)).astype(np.float32)
