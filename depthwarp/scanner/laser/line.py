"""Finding the laser line in a frame, from raw numbers to sub-pixel columns with their sigmas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_positive, check_size
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser.color_model import ColorKind
from depthwarp.scanner.laser.color_table import ColorTable
from depthwarp.scanner.laser.colors import FULL_LEVEL
from depthwarp.scanner.laser.continuity import is_connected
from depthwarp.scanner.laser.layouts import color_layout, signal_layout
from depthwarp.scanner.laser.line_ends import is_beside_end
from depthwarp.scanner.laser.points import LineCounts, LinePoints, PointFlag
from depthwarp_kernels import laser_color, laser_line, laser_peak, laser_position, laser_signal

__all__ = ["LineFinder", "SensorNoise", "derivative_filters"]

FILTER_DEVIATIONS = tuple(1.5**n for n in range(7))
"""Standard deviations of the Gaussians whose derivatives are the filters [px]: 1 to 11.4."""

FILTER_REACH = 3.0  # deviations
FILTER_UNIT = 4096  # greatest weight
BRIDGE_PX = 8  # a saturated core that the colour model does not know is not wider
RIVAL_SHARE = 0.5

MIN_SIDE = 8  # pixels; so small a frame still has a background beside a line


@dataclass(frozen=True)
class SensorNoise:
    """Noise of a number of the frame: variance = read^2 + shot * level.

    Attributes:
        read: Standard deviation in the dark [grey levels of 255].
        shot: Growth of the variance with the level [grey levels of 255].

    Raises:
        InputError: A read noise that is not above 0, or a negative shot noise.
    """

    read: float = 2.5
    shot: float = 0.0

    def __post_init__(self) -> None:
        check_positive("read noise", self.read, "grey levels")
        if self.shot != 0.0:
            check_positive("shot noise", self.shot, "grey levels")


class LineFinder:
    """Finds the line in frames of one kind; owns the buffers for it.

    Args:
        table: What colours the line has.
        size: (width, height) of the upright frames [px].
        pixel_format: BGR or a Bayer mosaic.
        bits: Significant bits of a number of the frames.
        noise: Of the sensor; for `sigma_px` and for what stands out.
        min_snr: Least height of a blurred peak over its background, in deviations of its noise.
        max_width_px: Greatest width of the line at half height.
        device: Warp device; the same frame gives the same bits on all of them.

    Raises:
        InputError: Mono frames, a size below 8 pixels, or parameters out of range.
        DeviceError: There is no such device.
    """

    def __init__(
        self,
        table: ColorTable,
        size: Sequence[int],
        pixel_format: PixelFormat,
        bits: int = 8,
        *,
        noise: SensorNoise | None = None,
        min_snr: float = 4.0,
        max_width_px: float = 30.0,
        device: str | None = "cpu",
    ) -> None:
        width, height = check_size(size)
        if min(width, height) < MIN_SIDE:
            raise InputError(f"frames must be at least {MIN_SIDE} pixels a side, got {size}")
        if pixel_format is PixelFormat.MONO:
            raise InputError("the line is found by its colour: need BGR or Bayer frames, got mono")
        if not 8 <= bits <= 16:
            raise InputError(f"bits must be from 8 to 16, got {bits}")
        check_positive("min_snr", min_snr)
        check_positive("max_width_px", max_width_px, "px")
        self._table = table
        self._size = (width, height)
        self._format = pixel_format
        self._bits = bits
        self._device = resolve_device(device)

        channel, share = table.model.channel, table.model.suppression
        noise = noise or SensorNoise()
        unit = (2**bits - 1) / FULL_LEVEL
        variances = ((noise.read * unit) ** 2, noise.shot * unit)
        self._color = color_layout(self._size, pixel_format, bits)
        self._signal = signal_layout(self._size, pixel_format, bits, channel, share, variances)
        cell = 2 if pixel_format.is_bayer else 1
        self._search = _search(cell, min_snr, max_width_px)

        count = width * height * (1 if pixel_format.is_bayer else 3)
        self._on = _FrameBuffer(count, bits, self._device)
        self._off = _FrameBuffer(count, bits, self._device)
        self._words = arrays.share(table.words, wp.uint64, self._device)
        self._filters = _filters(self._device)
        self._mask = arrays.empty((height // cell, width // cell), wp.uint8, self._device)
        self._reach = arrays.zeros(height, wp.int32, self._device)
        self._columns = arrays.zeros(height, wp.float64, self._device)
        self._quality = arrays.zeros(height, wp.vec3f, self._device)
        self._states = arrays.zeros(height, wp.int32, self._device)

    def find(self, frame: Frame, off: Frame | None = None) -> LinePoints:
        """The line's crossing of each row.

        Besides the result nothing is allocated on the device.

        Args:
            frame: With the laser on.
            off: The same view with the laser off; its colours and its light are then taken away.
                A model of lit colours still looks at the lit frame's colours.

        Raises:
            InputError: A frame of another size, format or depth than the finder was made for, or
                no off frame for a model of differences.
        """
        self._check(frame, "frame")
        self._on.fill(frame.pixels)
        if off is not None:
            self._check(off, "off frame")
            self._off.fill(off.pixels)
        elif self._table.model.kind is ColorKind.DIFFERENCE:
            raise InputError(
                "this colour model knows differences to a frame with the laser off: give one, or "
                "fit a model of lit frames"
            )
        self._launch(is_paired=off is not None)
        return self._points()

    def mask(self) -> npt.NDArray[np.bool_]:
        """Where the last frame had the line's colour: (H, W), or the cells (H // 2, W // 2)."""
        return np.asarray(self._mask.numpy() != 0)

    def _check(self, frame: Frame, name: str) -> None:
        height, width = frame.pixels.shape[:2]
        got = ((width, height), frame.pixel_format, frame.bits)
        wanted = (self._size, self._format, self._bits)
        if got != wanted or frame.pixels.dtype != self._on.dtype:
            raise InputError(
                f"{name} must be {_describe(*wanted)} in {self._on.dtype}, got "
                f"{_describe(*got)} in {frame.pixels.dtype}: make a finder for such frames, or set "
                "the camera back"
            )

    def _launch(self, is_paired: bool) -> None:
        """Classify, then search the rows. Graph-capture safe once the kernels are loaded."""
        on, off = self._on.array, (self._off if is_paired else self._on).array
        self._color.is_paired = is_paired and self._table.model.kind is ColorKind.DIFFERENCE
        self._signal.is_paired = is_paired
        rows, columns = self._mask.shape
        wp.launch(
            laser_color.classify,
            dim=(rows, -(-columns // laser_color.SPAN)),
            inputs=[on, off, self._color, self._words],
            outputs=[self._mask],
            device=self._device,
        )
        inputs = [on, off, self._signal, self._search, self._mask, self._filters]
        outputs = [self._columns, self._quality, self._states]
        self._launch_rows(laser_line.find_line, inputs, outputs)
        if self._signal.kind == laser_signal.MOSAIC_GREEN:
            found = [self._columns, self._states]
            self._launch_rows(laser_line.find_reach, found, [self._reach])
            self._launch_rows(laser_line.find_leaning_line, [*inputs, self._reach], outputs)

    def _launch_rows(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch(kernel, dim=self._size[1], inputs=inputs, outputs=outputs, device=self._device)

    def _points(self) -> LinePoints:
        codes = self._states.numpy()
        states, columns = codes & laser_line.STATE_BITS, self._columns.numpy()
        candidates = np.flatnonzero(states == laser_peak.ROW_FOUND).astype(np.int32)
        connected = candidates[is_connected(candidates, columns[candidates])]
        quality = self._quality.numpy().astype(np.float64)
        beside = is_beside_end(connected, columns[connected], quality[connected, 0])
        rows = connected[~beside]
        sigma, height, width = quality[rows].T
        flags = np.zeros(len(rows), np.uint8)
        for bit, flag in (
            (laser_line.FLAG_SATURATED, PointFlag.SATURATED),
            (laser_line.FLAG_RIVAL, PointFlag.RIVAL),
            (laser_line.FLAG_GAUSS, PointFlag.NARROW),
        ):
            flags[codes[rows] & bit != 0] |= np.uint8(flag)
        tally = np.bincount(states, minlength=laser_peak.ROW_FOUND + 1).tolist()
        return LinePoints(
            rows=rows,
            columns=columns[rows],
            sigma_px=sigma,
            peak=height * (FULL_LEVEL / (2**self._bits - 1)),
            width_px=width,
            flags=flags,
            counts=LineCounts(
                total=len(states),
                empty=tally[laser_peak.ROW_EMPTY],
                weak=tally[laser_peak.ROW_WEAK],
                wide=tally[laser_peak.ROW_WIDE],
                cut=tally[laser_peak.ROW_CUT],
                isolated=len(candidates) - len(connected),
                beside=int(beside.sum()),
                found=len(rows),
                rivals=int((flags & PointFlag.RIVAL != 0).sum()),
            ),
        )


class _FrameBuffer:
    """A frame's numbers on the device, and where it is not the CPU, pinned memory on the way."""

    def __init__(self, count: int, bits: int, device: Any) -> None:
        kind: Any = wp.uint8 if bits == 8 else wp.uint16
        self.array: Any = arrays.empty(count, kind, device)
        self._staging: Any = self.array
        if device.is_cuda:
            self._staging = wp.empty(count, dtype=kind, device="cpu", pinned=True)
        self._host = self._staging.numpy()
        self.dtype = self._host.dtype

    def fill(self, pixels: npt.NDArray[Any]) -> None:
        """Copy a frame, whatever its strides, into the buffer."""
        np.copyto(self._host.reshape(pixels.shape), pixels)
        if self._staging is not self.array:
            wp.copy(self.array, self._staging)


def derivative_filters() -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """Derivatives of Gaussians in whole numbers, and the lines that each is for.

    Returns:
        Weights, shape (S, 1 + R): reach of the filter, then its weight at distance 1, 2, ...; and
        the greatest standard deviation of a line for which the filter is used [px], shape (S,).
    """
    deviations = np.array(FILTER_DEVIATIONS)
    reaches = np.ceil(FILTER_REACH * deviations).astype(np.int32)
    weights = np.zeros((len(deviations), 1 + int(reaches.max())), np.int32)
    for row, deviation, reach in zip(weights, deviations, reaches, strict=True):
        k = np.arange(1, reach + 1)
        shape = k * np.exp(-0.5 * (k / deviation) ** 2)
        row[0] = reach
        row[1 : reach + 1] = np.rint(shape * (FILTER_UNIT / shape.max()))
    return weights, deviations * float(np.sqrt(1.5))


def _filters(device: Any) -> Any:
    weights, limits = derivative_filters()
    filters: Any = laser_position.Filters()
    filters.weights = wp.array(weights, dtype=wp.int32, device=device)
    filters.limits = wp.array(limits, dtype=wp.float64, device=device)
    return filters


def _search(cell: int, min_snr: float, max_width_px: float) -> Any:
    search: Any = laser_line.LineSearch()
    search.min_snr = min_snr
    search.max_width = max_width_px
    search.bridge = BRIDGE_PX // cell
    search.cell = cell
    search.rival_share = RIVAL_SHARE
    return search


def _describe(size: tuple[int, int], pixel_format: PixelFormat, bits: int) -> str:
    return f"{size[0]} x {size[1]} {pixel_format.value} of {bits} bits"
