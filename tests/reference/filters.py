"""The paper's two filters on a depth map, sections 3.4 and 3.5, as plain loops over a window."""

from __future__ import annotations

import numpy as np

from .precision import rounded

EMPTY, MEASURED, FILLED, ERASED = 0, 1, 2, 3  # codes of the state map, uint8

Maps = tuple[np.ndarray, np.ndarray, np.ndarray]


def measured_state(depth: np.ndarray) -> np.ndarray:
    """The state map of a freshly rendered depth map: MEASURED where not empty."""
    return np.where(depth > 0, MEASURED, EMPTY).astype(np.uint8)


def window(u: int, v: int, side: int, width: int, height: int) -> tuple[slice, slice]:
    """(rows, columns) of the window of (u, v): u - side//2 .. u - side//2 + side - 1, in the image.

    This is cv2.dilate's window for a side x side element with the default anchor: an even one
    reaches one pixel farther to the left and up.
    """
    first_u, first_v = u - side // 2, v - side // 2
    columns = slice(max(first_u, 0), min(first_u + side, width))
    rows = slice(max(first_v, 0), min(first_v + side, height))
    return rows, columns


def erase(
    depth: np.ndarray,
    index: np.ndarray,
    state: np.ndarray,
    side: int = 10,
    threshold: float = 0.5,
) -> Maps:
    """Hidden-point erase: a pixel goes if a pixel of its window is nearer by more than `threshold`.

    That is, `depth(p) - depth(q) > threshold` in float32 for some q that is not empty. Every
    decision reads the map as it was. An erased pixel has depth 0, index -1, state ERASED.
    """
    height, width = depth.shape
    threshold32 = rounded(threshold, np.float32)
    depth_out, index_out, state_out = depth.copy(), index.copy(), state.copy()
    for v in range(height):
        for u in range(width):
            d = depth[v, u]
            if d == 0:
                continue
            neighbours = depth[window(u, v, side, width, height)].ravel()
            with np.errstate(invalid="ignore"):  # of two infinite depths neither is nearer
                hidden = any(q > 0 and d - q > threshold32 for q in neighbours)
            if hidden:
                depth_out[v, u], index_out[v, u], state_out[v, u] = 0, -1, ERASED
    return depth_out, index_out, state_out


def dilate(
    depth: np.ndarray,
    index: np.ndarray,
    state: np.ndarray,
    side: int = 10,
    grow: str = "paper",
) -> Maps:
    """Grey dilation by a square of ones; `grow` names the surface that wins a window.

    `paper`: the largest depth, as cv2.dilate does it; `nearest`: the smallest depth that is not
    empty. Among equal depths the lowest point index wins. The pixel takes the winner's depth and
    index and becomes FILLED, unless both were its own already: then it keeps its state. A pixel
    with an empty window stays as it is, ERASED included. Every window reads the map as it was.
    """
    if grow not in ("paper", "nearest"):
        raise ValueError(f"grow must be 'paper' or 'nearest', got {grow!r}")
    height, width = depth.shape
    depth_out, index_out, state_out = depth.copy(), index.copy(), state.copy()
    for v in range(height):
        for u in range(width):
            area = window(u, v, side, width, height)
            found = [(d, i) for d, i in zip(depth[area].flat, index[area].flat, strict=True) if d]
            if not found:
                continue
            if grow == "paper":
                winner = min(found, key=lambda pair: (-pair[0], pair[1]))
            else:
                winner = min(found)
            if winner == (depth[v, u], index[v, u]):
                continue
            depth_out[v, u], index_out[v, u] = winner
            state_out[v, u] = FILLED
    return depth_out, index_out, state_out
