"""Learning the colour of a laser line: from marked pixels, on/off pairs, or a single lit frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.frames import Frame
from depthwarp.scanner.laser.color_model import ColorKind, LaserColorModel
from depthwarp.scanner.laser.colors import CHANNELS, FULL_LEVEL, frame_colors
from depthwarp.scanner.laser.mixture import GaussianMixture, fit_mixture

__all__ = ["fit_lit", "fit_marked", "fit_pairs"]

LASER_COMPONENTS = 3  # the last one is the saturated core
BACKGROUND_COMPONENTS = 5
UNSEEN_WEIGHT = 1e-4  # of a component of the background that no sample is needed for
MAX_SAMPLES = 20_000  # of each class; more change the mixtures no more

CORE_LEVEL = 250.0  # of 255: from here on the laser's channel counts as saturated
FEWEST = 50  # pixels of the line and of the scene to learn from
CORE_FEW = 20  # saturated pixels, below which they do not make a component of their own
CORE_OTHERS, CORE_DEVIATION = 180.0, 60.0  # other channels of a core that was never seen
CORE_OWN = {ColorKind.LIT: 5.0, ColorKind.DIFFERENCE: 30.0}  # deviation of its own channel
CORE_WEIGHT = 0.1

SEED_SHARE = 0.5  # of the brightest signal of its row: what is above is line
SEED_NOISES = 6.0  # and above this many standard deviations of the noise
SEED_MIN_LEVEL = 12.0  # and above this many grey levels
SEED_MAX_WIDTH = 60  # more line than this in a row is a lamp or a glow, no line
MARGIN = 3  # pixels or cells beside the line that are neither line nor background

Colors = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Sample:
    """One view to learn from.

    Attributes:
        colors: What the model shall know, shape (H, W, 3).
        lit: Colours of the lit frame, by which saturation is told, shape (H, W, 3).
        line: What is line, shape (H, W).
    """

    colors: Colors
    lit: Colors
    line: Mask


def fit_marked(
    frames: Sequence[Frame], marked: Sequence[Mask], *, prior: float = 0.01, seed: int = 0
) -> LaserColorModel:
    """Fit a model to frames in which somebody has marked the line.

    Args:
        frames: Frames with the laser on, BGR or Bayer.
        marked: For each frame the pixels of the line, shape (H, W); all others are background
            but for a margin of a few pixels.
        prior: Share of pixels that show the line.
        seed: Of the choice of samples and of first means.

    Raises:
        InputError: Masks that do not fit the frames, or too little marked.
    """
    samples = []
    for frame, mask in zip(frames, marked, strict=True):
        if mask.shape != frame.pixels.shape[:2] or mask.dtype != np.bool_:
            raise InputError(
                f"marked pixels must be booleans of shape {frame.pixels.shape[:2]}, got "
                f"{mask.dtype} of shape {mask.shape}"
            )
        colors = frame_colors(frame)
        if frame.pixel_format.is_bayer:
            height, width = colors.shape[:2]
            cells = mask[: 2 * height, : 2 * width].reshape(height, 2, width, 2)
            mask = np.asarray(cells.any(axis=(1, 3)))
        samples.append(_Sample(colors, colors, mask))
    return _fit(samples, ColorKind.LIT, prior, seed)


def fit_pairs(
    pairs: Sequence[tuple[Frame, Frame]],
    *,
    kind: ColorKind = ColorKind.DIFFERENCE,
    prior: float = 0.01,
    seed: int = 0,
) -> LaserColorModel:
    """Fit a model to pairs of frames with the laser on and off: nobody has to mark anything.

    The line is where the difference is at least half of the strongest one of its row.

    Args:
        pairs: (laser on, laser off), each of one view.
        kind: Whether the model shall know colours of differences, for scans that take an off
            frame at each stop, or colours of lit frames, for scans that do not.
        prior: Share of pixels that show the line.
        seed: Of the choice of samples and of first means.

    Raises:
        InputError: Frames that do not match, or no line in the differences.
    """
    samples = []
    for on, off in pairs:
        difference = frame_colors(on, off)
        lit = frame_colors(on)
        colors = difference if kind is ColorKind.DIFFERENCE else lit
        strongest = [np.percentile(difference[..., c], 99.9) for c in range(3)]
        seeds = _line_seeds(difference[..., int(np.argmax(strongest))])
        samples.append(_Sample(colors, lit, seeds))
    return _fit(samples, kind, prior, seed)


def fit_lit(
    frames: Sequence[Frame], channel: str, *, prior: float = 0.01, seed: int = 0
) -> LaserColorModel:
    """Fit a model to frames with the laser on, given no more than the laser's colour.

    The line is where the colour stands out from grey (2G - R - B for a green laser), at least
    half as much as at the strongest place of its row; a gap that is brighter than both of its
    sides is the saturated core and belongs to it.

    Args:
        frames: Frames in which little but the line has that colour.
        channel: "red", "green" or "blue".
        prior: Share of pixels that show the line.
        seed: Of the choice of samples and of first means.

    Raises:
        InputError: An unknown channel, or nothing of that colour in the frames.
    """
    if channel not in CHANNELS:
        raise InputError(f"channel must be one of {', '.join(CHANNELS)}, got {channel!r}")
    own = CHANNELS.index(channel)
    samples = []
    for frame in frames:
        colors = frame_colors(frame)
        excess = colors[..., own] - (colors.sum(axis=2) - colors[..., own]) / 2.0
        seeds = _line_seeds(excess)
        seeds |= _saturated_gaps(seeds, colors[..., own])
        samples.append(_Sample(colors, colors, seeds))
    return _fit(samples, ColorKind.LIT, prior, seed)


def _line_seeds(signal: Colors) -> Mask:
    """Pixels that surely are line, by a signal in which the line is bright."""
    median = float(np.median(signal))
    noise = 1.4826 * float(np.median(np.abs(signal - median)))  # of a normal distribution
    floor = median + max(SEED_NOISES * noise, SEED_MIN_LEVEL)
    highest = signal.max(axis=1, keepdims=True)
    seeds = (signal >= floor) & (signal >= SEED_SHARE * highest)
    seeds &= seeds.sum(axis=1, keepdims=True) <= SEED_MAX_WIDTH
    return np.asarray(seeds)


def _saturated_gaps(seeds: Mask, own: Colors) -> Mask:
    """Saturated pixels between seeds of one row that are near each other."""
    reach = np.ones((1, SEED_MAX_WIDTH // 2 + 1), np.uint8)
    closed = cv2.morphologyEx(seeds.astype(np.uint8), cv2.MORPH_CLOSE, reach)
    return np.asarray((closed > 0) & (own >= CORE_LEVEL))


def _fit(samples: Sequence[_Sample], kind: ColorKind, prior: float, seed: int) -> LaserColorModel:
    rng = np.random.default_rng(seed)
    laser = np.concatenate([np.empty((0, 3)), *(s.colors[s.line] for s in samples)])
    lit = np.concatenate([np.empty((0, 3)), *(s.lit[s.line] for s in samples)])
    background = np.concatenate([np.empty((0, 3)), *(_scene_colors(s, rng) for s in samples)])
    if len(laser) < FEWEST or len(background) < FEWEST:
        raise InputError(
            f"no laser line is in view that its colour could be learned from: {len(laser)} pixels "
            f"of a line and {len(background)} of the scene, need {FEWEST} of each; check that the "
            "laser is on, in view, and stands out in at least one frame"
        )
    chosen = _choose(len(laser), rng)
    channel = int(np.argmax(laser.mean(axis=0) - background.mean(axis=0)))
    in_core = lit[chosen, channel] >= CORE_LEVEL
    return LaserColorModel(
        laser=_laser_mixture(laser[chosen], in_core, kind, channel, seed),
        background=_background_mixture(background[_choose(len(background), rng)], seed),
        prior=prior,
        kind=kind,
        channel=channel,
    )


def _scene_colors(sample: _Sample, rng: np.random.Generator) -> Colors:
    """Colours of one view that are not line nor right beside it."""
    window = np.ones((2 * MARGIN + 1, 2 * MARGIN + 1), np.uint8)
    colors = sample.colors[cv2.dilate(sample.line.astype(np.uint8), window) == 0]
    return np.asarray(colors[_choose(len(colors), rng)])


def _choose(count: int, rng: np.random.Generator) -> npt.NDArray[np.intp]:
    """Which of `count` to take: all, or `MAX_SAMPLES` of them at random."""
    if count <= MAX_SAMPLES:
        return np.arange(count)
    return np.sort(rng.choice(count, MAX_SAMPLES, replace=False))


def _background_mixture(colors: Colors, seed: int) -> GaussianMixture:
    """Components by EM, and a wide one for colours of things that were not in view."""
    seen = fit_mixture(colors, BACKGROUND_COMPONENTS, seed).mixture
    return GaussianMixture(
        weights=np.append((1.0 - UNSEEN_WEIGHT) * seen.weights, UNSEEN_WEIGHT),
        means=np.vstack([seen.means, np.full(3, FULL_LEVEL / 2)]),
        covariances=np.concatenate([seen.covariances, np.eye(3)[None] * (FULL_LEVEL / 2) ** 2]),
    )


def _laser_mixture(
    colors: Colors, in_core: Mask, kind: ColorKind, channel: int, seed: int
) -> GaussianMixture:
    """Components by EM for what is not saturated, and the core from what is."""
    if in_core.sum() < CORE_FEW:
        core, weight, body = _usual_core(kind, channel), CORE_WEIGHT, colors
    else:
        core = fit_mixture(colors[in_core], 1, seed).mixture
        weight, body = float(in_core.mean()), colors[~in_core]
    if len(body) < FEWEST:
        raise InputError(
            "the laser line is saturated everywhere, its colour cannot be learned: shorten the "
            "exposure of the frames to learn from"
        )
    seen = fit_mixture(body, LASER_COMPONENTS - 1, seed).mixture
    return GaussianMixture(
        weights=np.concatenate([(1.0 - weight) * seen.weights, weight * core.weights]),
        means=np.concatenate([seen.means, core.means]),
        covariances=np.concatenate([seen.covariances, core.covariances]),
    )


def _usual_core(kind: ColorKind, channel: int) -> GaussianMixture:
    """The core that any sensor would show, for a line that was not seen saturated.

    The laser's channel is full, in a difference less the light of the scene; the others are
    anywhere from the laser's pure colour to white.
    """
    mean, deviations = np.full((1, 3), CORE_OTHERS), np.full(3, CORE_DEVIATION)
    deviations[channel] = CORE_OWN[kind]
    mean[0, channel] = FULL_LEVEL - (0.0 if kind is ColorKind.LIT else CORE_OWN[kind])
    return GaussianMixture(np.ones(1), mean, np.diag(deviations**2)[None])
