"""A colour model baked into a table, so that a frame is classified by one look-up a pixel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.errors import InputError
from depthwarp.scanner.frames import Frame
from depthwarp.scanner.laser.color_model import ColorKind, LaserColorModel
from depthwarp.scanner.laser.colors import frame_colors
from depthwarp_kernels import laser_color

__all__ = ["ColorTable"]


class ColorTable:
    """Which colours are the line's: one bit for each colour of 8 bits a channel, 2 MiB.

    The upper 6 bits of blue, green and red choose one of 262,144 words, the lower 2 bits of each
    one of its 64 bits. For 8-bit colours it is therefore no approximation of the posterior; other
    colours are rounded to 8 bits. Baking takes about a second; do it once for a model.

    Args:
        model: What colours the line has.
        least_posterior: Probability from which a colour is the line's.

    Attributes:
        model: The model.
        words: Shape (262144,), uint64.

    Raises:
        InputError: A probability that is not between 0 and 1.
    """

    def __init__(self, model: LaserColorModel, least_posterior: float = 0.5) -> None:
        if not 0.0 < least_posterior < 1.0:
            raise InputError(f"least_posterior must be above 0 and below 1, got {least_posterior}")
        self.model = model
        # The host bakes for every device: exponentials do not round alike on all of them.
        words = arrays.empty(laser_color.TABLE_WORDS, wp.uint64, "cpu")
        wp.launch(
            laser_color.bake,
            dim=laser_color.TABLE_WORDS,
            inputs=[
                _components(model),
                len(model.laser.weights),
                _log_odds(least_posterior) - _log_odds(model.prior),
            ],
            outputs=[words],
            device="cpu",
        )
        self.words: npt.NDArray[np.uint64] = words.numpy()
        self.words.flags.writeable = False

    def contains(self, colors: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether colours, shape (..., 3) [grey levels of 255], are the line's; shape (...)."""
        levels = np.clip(np.floor(np.asarray(colors, dtype=np.float64) + 0.5), 0, 255)
        blue, green, red = np.moveaxis(levels.astype(np.int64), -1, 0)
        words = self.words[(blue >> 2 << 12) | (green >> 2 << 6) | (red >> 2)]
        bits = ((blue & 3) << 4) | ((green & 3) << 2) | (red & 3)
        return np.asarray((words >> bits.astype(np.uint64)) & np.uint64(1) == 1)

    def mask(self, frame: Frame, off: Frame | None = None) -> npt.NDArray[np.bool_]:
        """Where a frame shows the line: a slow look, to check a model by.

        Returns:
            Shape (H, W), or (H // 2, W // 2) for the cells of a Bayer frame.

        Raises:
            InputError: No off frame for a model of differences, or frames that do not match.
        """
        if self.model.kind is ColorKind.LIT:
            return self.contains(frame_colors(frame))
        if off is None:
            raise InputError(
                "this colour model knows differences to a frame with the laser off: give one, or "
                "fit a model of lit frames"
            )
        return self.contains(frame_colors(frame, off))


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _components(model: LaserColorModel) -> Any:
    """All Gaussians as an array of `ColorComponent`, the line's first."""
    components = []
    for mixture in (model.laser, model.background):
        for weight, mean, covariance in zip(
            mixture.weights, mixture.means, mixture.covariances, strict=True
        ):
            root = np.linalg.cholesky(covariance)
            component: Any = laser_color.ColorComponent()
            component.log_scale = math.log(weight) - float(np.log(np.diag(root)).sum())
            component.mean = wp.vec3d(*mean.tolist())
            component.whiten = wp.mat33d(*np.linalg.inv(root).ravel().tolist())
            components.append(component)
    return wp.array(components, dtype=laser_color.ColorComponent, device="cpu")
