"""Frames of a laser line that runs down them, with everything about it known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorKind,
    ColorTable,
    LineFinder,
    LinePoints,
    SensorNoise,
    fit_pairs,
)
from depthwarp.scanner.laser.colors import channel_sites

HEIGHT, WIDTH = 1000, 96
TRAINING_HEIGHT = 400
AMBIENT = np.array([22.0, 20.0, 24.0])  # blue, green, red
GREEN_LASER = np.array([0.25, 1.0, 0.12])
RED_LASER = np.array([0.05, 0.15, 1.0])
NOISE = 2.5
SUBPIXELS = (np.arange(5) - 2) / 5  # where the light of a pixel is sampled

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """A line down a frame: one crossing a row, Gaussian across.

    Attributes:
        columns: Its middle in each row [px], shape (H,).
        sigma: Standard deviation across [px].
        amplitude: Light of its own channel at the middle [grey levels], before saturation.
        color: Share of the light in blue, green, red.
        speckle: Contrast of a modulation with a grain of two pixels.
    """

    columns: Floats
    sigma: float = 1.5
    amplitude: float | Floats = 150.0
    color: tuple[float, float, float] = (0.25, 1.0, 0.12)
    speckle: float = 0.0


def random_columns(rng: np.random.Generator, height: int = HEIGHT, width: int = WIDTH) -> Floats:
    """Columns about the middle, a new sub-pixel phase in each row but hardly another column."""
    slow = np.cumsum(rng.uniform(-0.2, 0.2, height))
    slow -= np.linspace(slow[0], slow[-1], height)
    return np.asarray(width / 2 + np.clip(slow, -width / 6, width / 6), np.float64)


def straight_columns(slope: float, height: int = HEIGHT, width: int = WIDTH) -> Floats:
    """Columns of a straight line through the middle of a frame, `slope` columns a row."""
    return np.asarray(width / 2 + slope * (np.arange(height) - height / 2), np.float64)


def light(lines: list[Line], rng: np.random.Generator, width: int = WIDTH) -> Floats:
    """Light of the lines, shape (H, W, 3) [grey levels], averaged over each pixel's area."""
    height = len(lines[0].columns)
    total = np.zeros((height, width, 3))
    for line in lines:
        across = np.zeros((height, width))
        for shift in SUBPIXELS:
            distance = np.arange(width) + shift - line.columns[:, None]
            across += np.exp(-0.5 * (distance / line.sigma) ** 2) / len(SUBPIXELS)
        if line.speckle > 0:
            grains = rng.gamma(line.speckle**-2, line.speckle**2, (height, width // 2 + 1))
            across *= np.repeat(grains, 2, axis=1)[:, :width]
        amplitude = np.broadcast_to(line.amplitude, height)[:, None, None]
        total += across[..., None] * amplitude * np.array(line.color)
    return total


def frame(
    values: Floats,
    rng: np.random.Generator,
    pixel_format: PixelFormat = PixelFormat.BGR,
    bits: int = 8,
    noise: float = NOISE,
) -> Frame:
    """A frame of light in grey levels, shape (H, W, 3), with noise, saturation and rounding."""
    if pixel_format.is_bayer:
        mosaic = np.empty(values.shape[:2])
        for channel, sites in enumerate(channel_sites(pixel_format)):
            for row, column in sites:
                mosaic[row::2, column::2] = values[row::2, column::2, channel]
        values = mosaic
    full = 2**bits - 1
    noisy = (values + rng.normal(0.0, noise, values.shape)) * (full / 255.0)
    pixels = np.clip(np.rint(noisy), 0, full).astype(np.uint8 if bits == 8 else np.uint16)
    return Frame(pixels, pixel_format, bits, 1000.0, 0.0, 0, None, 0)


def pair(
    lines: list[Line],
    rng: np.random.Generator,
    pixel_format: PixelFormat = PixelFormat.BGR,
    bits: int = 8,
    noise: float = NOISE,
    width: int = WIDTH,
) -> tuple[Frame, Frame]:
    """Frames with the laser on and off."""
    lit = light(lines, rng, width)
    off = np.broadcast_to(AMBIENT, lit.shape)
    return (
        frame(AMBIENT + lit, rng, pixel_format, bits, noise),
        frame(off, rng, pixel_format, bits, noise),
    )


@cache
def table(kind: ColorKind, is_mosaic: bool, is_red: bool = False) -> ColorTable:
    """A table learned from one pair in which the line goes from weak to saturated."""
    rng = np.random.default_rng(5)
    line = Line(
        random_columns(rng, TRAINING_HEIGHT),
        amplitude=np.geomspace(20.0, 800.0, TRAINING_HEIGHT),
        color=tuple((RED_LASER if is_red else GREEN_LASER).tolist()),
    )
    pixel_format = PixelFormat.BAYER_RGGB if is_mosaic else PixelFormat.BGR
    return ColorTable(fit_pairs([pair([line], rng, pixel_format)], kind=kind))


def find(
    lines: list[Line],
    pixel_format: PixelFormat = PixelFormat.BGR,
    kind: ColorKind = ColorKind.LIT,
    *,
    bits: int = 8,
    noise: float = NOISE,
    device: str = "cpu",
    is_red: bool = False,
) -> LinePoints:
    """Points of the lines in a rendered frame, or in a pair for a model of differences."""
    on, off = pair(lines, np.random.default_rng(6), pixel_format, bits, noise)
    finder = LineFinder(
        table(kind, pixel_format.is_bayer, is_red),
        (WIDTH, len(lines[0].columns)),
        pixel_format,
        bits,
        noise=SensorNoise(max(noise, 0.3)),
        device=device,
    )
    return finder.find(on, off if kind is ColorKind.DIFFERENCE else None)


def slanted(slope: float = 0.037, **properties: Any) -> Line:
    """A line that passes all sub-pixel phases."""
    return replace(Line(straight_columns(slope, HEIGHT)), **properties)


def errors(points: LinePoints, line: Line) -> Floats:
    """Found less true column of each point [px]."""
    return points.columns - line.columns[points.rows]
