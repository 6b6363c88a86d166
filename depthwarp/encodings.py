"""Depth as 16-bit numbers: the paper's quantization and the two usual ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_choice
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp_kernels.encode import encode_uint16

__all__ = ["Encoding", "EncodingName", "decode_depth", "encode_depth", "get_encoding"]

EncodingName = Literal["range16", "millimetres", "kitti"]
ENCODINGS: tuple[EncodingName, ...] = ("range16", "millimetres", "kitti")


@dataclass(frozen=True)
class Encoding:
    """`value = round(depth / divisor * factor)`, 0 is empty, the smallest depth is 1.

    Attributes:
        name: Name of the encoding.
        divisor: Metres at which `factor` is reached.
        factor: Value of a depth of `divisor` metres.
    """

    name: EncodingName
    divisor: float
    factor: float

    @property
    def largest(self) -> float:
        """Largest depth that 16 bits can hold [m]."""
        return 65535 / self.factor * self.divisor


def get_encoding(name: EncodingName, max_range: float) -> Encoding:
    """The encoding of a name.

    Args:
        name: `"range16"`: the paper's, 65535 is `max_range`; `"millimetres"`: RGB-D cameras;
            `"kitti"`: metres times 256.
        max_range: Depth of the value 65535 [m]; used by `"range16"`.

    Raises:
        InputError: An unknown name, or `"range16"` without a finite range.
    """
    check_choice("encoding", name, ENCODINGS)
    if name == "millimetres":
        return Encoding(name, 1.0, 1000.0)
    if name == "kitti":
        return Encoding(name, 1.0, 256.0)
    if not np.isfinite(max_range):
        raise InputError(
            "encoding 'range16' needs a finite max_range: render with one, or save as .npz"
        )
    return Encoding(name, max_range, 65535.0)


def encode_depth(
    depth: npt.NDArray[np.float32], encoding: Encoding, *, device: str | None = None
) -> npt.NDArray[np.uint16]:
    """Quantize a depth map by 16 bits, section 3.4.

    Args:
        depth: Depth [m], shape (H, W), float32, 0 = empty.
        encoding: What the numbers mean.
        device: Where to compute; None is Warp's default device.

    Returns:
        Shape (H, W), uint16, 0 = empty.

    Raises:
        InputError: A depth is larger than 16 bits can hold.
    """
    target = resolve_device(device)
    values = arrays.empty(depth.shape, wp.uint16, target)
    overflow = arrays.zeros(1, wp.int32, target)
    wp.launch(
        encode_uint16,
        dim=depth.shape,
        inputs=[
            arrays.share(depth, wp.float32, target),
            wp.float64(encoding.divisor),
            wp.float64(encoding.factor),
        ],
        outputs=[values, overflow],
        device=target,
    )
    lost = int(overflow.numpy()[0])
    if lost:
        raise InputError(
            f"encoding '{encoding.name}' holds depths up to {encoding.largest:.3f} m, {lost} "
            "pixels are farther: render with a smaller max_range, or save as .npz or .tiff"
        )
    result: npt.NDArray[np.uint16] = values.numpy()
    return result


def decode_depth(values: npt.NDArray[np.uint16], encoding: Encoding) -> npt.NDArray[np.float32]:
    """The depth [m] of 16-bit numbers, shape (H, W), float32, 0 = empty."""
    depth: npt.NDArray[np.float32] = (values / encoding.factor * encoding.divisor).astype(
        np.float32
    )
    return depth
