"""Which rows hold a point of the line, what is said about them, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorKind,
    LineFinder,
    LineStatus,
    NoLineError,
    PointFlag,
    SensorNoise,
    TwoLinesError,
)
from tests.scanner.laser import synthetic
from tests.scanner.laser.synthetic import HEIGHT, Line, errors, find, slanted

BAYER = [pixel_format for pixel_format in PixelFormat if pixel_format.is_bayer]
FALSE_BEYOND = 3.0  # px


@pytest.mark.parametrize("slope", [-0.6, 0.6])
@pytest.mark.parametrize("pixel_format", [PixelFormat.BGR, PixelFormat.BAYER_RGGB])
def test_ends_of_a_line_are_not_pulled_aside(pixel_format: PixelFormat, slope: float) -> None:
    """Of a slanted line that ends square to itself, rows across the end give no wrong points."""
    line = slanted(slope, sigma=1.5)
    rng = np.random.default_rng(4)
    rows, columns = np.mgrid[:HEIGHT, : synthetic.WIDTH]
    along = rows - HEIGHT / 2 + slope * (columns - synthetic.WIDTH / 2)
    lit = synthetic.light([line], rng) * (np.abs(along) < 60)[..., None]
    off = np.broadcast_to(synthetic.AMBIENT, lit.shape)
    table = synthetic.table(ColorKind.DIFFERENCE, pixel_format.is_bayer)
    finder = LineFinder(table, (synthetic.WIDTH, HEIGHT), pixel_format)
    frames = [synthetic.frame(light, rng, pixel_format) for light in (synthetic.AMBIENT + lit, off)]
    points = finder.find(*frames)
    assert points.counts.beside >= 2
    assert points.counts.found > 0.9 * 120 / (1 + slope**2)
    assert np.abs(errors(points, line)).max() < 0.6


def test_flags() -> None:
    """Saturated, narrow and rivalled points say so, others do not."""
    rivals = [slanted(), Line(synthetic.straight_columns(0.037, HEIGHT) - 20.0, 1.5, 100.0)]
    assert (find([slanted()]).flags == 0).all()
    assert (find([slanted(amplitude=1000.0)]).flags == PointFlag.SATURATED).all()
    assert (find([slanted(sigma=0.35)]).flags & PointFlag.NARROW != 0).mean() > 0.5
    assert (find(rivals).flags & PointFlag.RIVAL != 0).mean() > 0.99


def test_a_frame_without_a_line() -> None:
    """An empty frame gives no points, and `check` says what became of the rows."""
    points = find([slanted(amplitude=0.0)], kind=ColorKind.DIFFERENCE)
    assert len(points.rows) == len(points.columns) == len(points.sigma_px) == 0
    assert points.status is LineStatus.NO_LINE
    with pytest.raises(NoLineError, match="no laser line in view: of 1000 rows"):
        points.check()


def test_two_lines() -> None:
    """Two lines alike are reported; the brighter one is still followed."""
    bright = slanted()
    dim = Line(bright.columns - 25.0, 1.5, 100.0)
    points = find([bright, dim])
    assert points.status is LineStatus.TWO_LINES
    assert np.abs(errors(points, bright)).max() < FALSE_BEYOND
    with pytest.raises(TwoLinesError, match="two laser lines"):
        points.check()
    fainter = find([bright, Line(bright.columns - 25.0, 1.5, 55.0)])
    assert fainter.status is LineStatus.FOUND
    assert fainter.check() is fainter


def test_wide_bands_and_lone_spots_are_no_line() -> None:
    """A band 47 px wide and spots of two rows are rejected and counted."""
    band = find([slanted(0.0, sigma=20.0)])
    assert band.counts.found == 0 and band.counts.wide + band.counts.weak > 0.9 * HEIGHT
    flashes = np.where(np.arange(HEIGHT) % 40 < 2, 150.0, 0.0)
    spots = find([Line(synthetic.straight_columns(0.0, HEIGHT), 1.5, flashes)])
    assert spots.counts.found == 0 and spots.counts.isolated >= 0.9 * HEIGHT / 20


def test_rows_are_accounted_for() -> None:
    """The parts of the counts add up, with gaps in the line."""
    amplitude = np.where(np.arange(HEIGHT) % 100 < 40, 150.0, 0.0)
    points = find([Line(synthetic.straight_columns(0.01, HEIGHT), 1.5, amplitude)])
    c = points.counts
    parts = (c.empty, c.weak, c.wide, c.cut, c.isolated, c.beside, c.found)
    assert sum(parts) == c.total == HEIGHT
    assert c.found == len(points.rows) == pytest.approx(0.4 * HEIGHT, abs=15)
    assert (np.diff(points.rows) > 0).all()


def test_off_frame_removes_the_scene() -> None:
    """With an off frame a bright edge right beside the line does not pull it."""
    line = slanted(0.0)
    rng = np.random.default_rng(1)
    scene = np.broadcast_to(synthetic.AMBIENT, (HEIGHT, synthetic.WIDTH, 3)).copy()
    scene[:, 50:] = 130.0
    lit = scene + synthetic.light([line], rng)
    on, off = synthetic.frame(lit, rng), synthetic.frame(scene, rng)
    table = synthetic.table(ColorKind.DIFFERENCE, is_mosaic=False)
    finder = LineFinder(table, (synthetic.WIDTH, HEIGHT), PixelFormat.BGR)
    points = finder.find(on, off)
    assert points.counts.found > 0.99 * HEIGHT
    assert abs(errors(points, line).mean()) < 0.01


def test_same_finder_same_answer(device: str) -> None:
    """A finder keeps nothing of the frame before: the same frame gives the same bits again."""
    rng = np.random.default_rng(6)
    first, second = (synthetic.pair([slanted(s)], rng) for s in (0.02, -0.02))
    table = synthetic.table(ColorKind.DIFFERENCE, is_mosaic=False)
    finder = LineFinder(table, (synthetic.WIDTH, HEIGHT), PixelFormat.BGR, device=device)
    before = finder.find(*first)
    finder.find(*second)
    again = finder.find(*first)
    np.testing.assert_array_equal(before.columns, again.columns)
    np.testing.assert_array_equal(before.sigma_px, again.sigma_px)
    backwards = np.ascontiguousarray(first[0].pixels[::-1, ::-1], np.uint8)[::-1, ::-1]
    strided = finder.find(Frame(backwards, *_rest(first[0])), first[1])
    np.testing.assert_array_equal(before.columns, strided.columns)


def _rest(frame: Frame) -> tuple[PixelFormat, int, float, float, int, None, int]:
    return (frame.pixel_format, frame.bits, 1.0, 0.0, 0, None, 0)


@pytest.mark.parametrize("pixel_format", [PixelFormat.BGR, *BAYER])
@pytest.mark.parametrize("size", [(8, 8), (9, 31), (64, 40)])
def test_any_frame_gives_finite_points(pixel_format: PixelFormat, size: tuple[int, int]) -> None:
    """Random numbers, all black and all white: nothing fails, what is found lies in the frame."""
    rng = np.random.default_rng(0)
    width, height = size
    shape = (height, width) if pixel_format.is_bayer else (height, width, 3)
    table = synthetic.table(ColorKind.LIT, pixel_format.is_bayer)
    finder = LineFinder(table, size, pixel_format)
    for low, high in ((0, 256), (0, 1), (255, 256), (150, 256)):
        pixels = rng.integers(low, high, shape, dtype=np.uint8)
        points = finder.find(Frame(pixels, pixel_format, 8, 1.0, 0.0, 0, None, 0))
        assert np.isfinite(points.sigma_px).all() and (points.sigma_px >= 0.01).all()
        assert ((points.columns >= 0) & (points.columns <= width - 1)).all()
        assert points.counts.total == height


def test_frames_of_another_kind_are_refused() -> None:
    """Wrong size, format, depth, a missing off frame: each says what was expected and given."""
    rng = np.random.default_rng(0)
    on, off = synthetic.pair([slanted()], rng)
    deep, _ = synthetic.pair([slanted()], rng, bits=12)
    mosaic, _ = synthetic.pair([slanted()], rng, PixelFormat.BAYER_RGGB)
    small = Frame(on.pixels[:-1], *_rest(on))
    table = synthetic.table(ColorKind.DIFFERENCE, is_mosaic=False)
    finder = LineFinder(table, (synthetic.WIDTH, HEIGHT), PixelFormat.BGR)
    for wrong, words in ((small, "96 x 999"), (deep, "12 bits"), (mosaic, "bayer_rggb")):
        with pytest.raises(InputError, match=words):
            finder.find(wrong, off)
        with pytest.raises(InputError, match=f"off frame must be .*{words}"):
            finder.find(on, wrong)
    with pytest.raises(InputError, match="laser off"):
        finder.find(on)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"pixel_format": PixelFormat.MONO}, "mono"),
        ({"size": (4, 100)}, "at least 8 pixels"),
        ({"bits": 7}, "bits"),
        ({"min_snr": 0.0}, "min_snr"),
        ({"max_width_px": -1.0}, "max_width_px"),
    ],
)
def test_finders_that_cannot_work_are_refused(arguments: dict[str, object], words: str) -> None:
    """Parameters out of range are named."""
    table = synthetic.table(ColorKind.LIT, is_mosaic=False)
    good: dict[str, object] = {"size": (64, 64), "pixel_format": PixelFormat.BGR}
    with pytest.raises(InputError, match=words):
        LineFinder(table, **(good | arguments))  # type: ignore[arg-type]


@pytest.mark.parametrize("arguments", [(0.0,), (-1.0,), (2.5, -0.1)])
def test_noise_that_is_none_is_refused(arguments: tuple[float, ...]) -> None:
    """Without noise there is no sigma; negative variances do not exist."""
    with pytest.raises(InputError, match="noise"):
        SensorNoise(*arguments)
