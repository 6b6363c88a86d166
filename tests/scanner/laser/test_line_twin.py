"""The kernel that finds the line, against its slow twin: the same bits, on every device."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import ColorKind, LineFinder, LinePoints, PointFlag, SensorNoise
from depthwarp.scanner.laser.continuity import is_connected
from depthwarp.scanner.laser.line_ends import is_beside_end
from tests.scanner.laser import synthetic
from tests.scanner.laser.reference import Found, RowFinder, natural_log

BAYER = [pixel_format for pixel_format in PixelFormat if pixel_format.is_bayer]
HEIGHT, WIDTH = 61, 57  # odd: no cell holds the last row and column of a mosaic
NOISE = SensorNoise(2.5, 0.05)


def hard_lines(rng: np.random.Generator, is_red: bool = False) -> list[synthetic.Line]:
    """A line with every difficulty, row by row, and a second one beside it."""
    color = synthetic.RED_LASER if is_red else synthetic.GREEN_LASER
    rows = np.arange(HEIGHT)
    columns = 12.0 + 22.0 * rows / HEIGHT + rng.uniform(-0.5, 0.5, HEIGHT)
    amplitude = rng.choice([0.0, 30.0, 60.0, 90.0, 150.0, 250.0, 900.0], HEIGHT)
    shared = tuple(color.tolist())
    return [
        synthetic.Line(columns[:30], 0.5, amplitude[:30], shared),
        synthetic.Line(columns[30:], 2.2, amplitude[30:], shared, speckle=0.3),
        synthetic.Line(np.full(HEIGHT, 48.0), 1.2, rng.choice([0.0, 80.0], HEIGHT), shared),
    ]


def hard_pair(pixel_format: PixelFormat, bits: int, is_red: bool) -> tuple[Frame, Frame]:
    """Frames of the hard lines, with the laser on and off, before an uneven background."""
    rng = np.random.default_rng(8)
    narrow, wide, second = hard_lines(rng, is_red)
    lit = np.concatenate(
        [synthetic.light([narrow], rng, WIDTH), synthetic.light([wide], rng, WIDTH)]
    )
    lit += synthetic.light([second], rng, WIDTH)
    dark = synthetic.AMBIENT + rng.uniform(0.0, 6.0, (HEIGHT, WIDTH, 1))
    return (
        synthetic.frame(dark + lit, rng, pixel_format, bits),
        synthetic.frame(dark, rng, pixel_format, bits),
    )


def by_twin(
    finder: LineFinder, on: Frame, off: Frame | None, channel: int, suppression: float
) -> dict[int, Found]:
    """What the twin finds with the finder's mask, lone points and bent ends left out."""
    unit = (2**on.bits - 1) / 255.0
    twin = RowFinder(
        on,
        off,
        finder.mask(),
        channel,
        round(suppression * 16),
        ((NOISE.read * unit) ** 2, NOISE.shot * unit),
    )
    found = twin.find_all()
    rows = np.array(list(found), np.int32)
    rows = rows[is_connected(rows, np.array([found[row].column for row in found]))]
    columns = np.array([found[row].column for row in rows.tolist()])
    sigma = np.array([found[row].sigma for row in rows.tolist()], np.float64)
    kept = rows[~is_beside_end(rows, columns, sigma)]
    return {row: found[row] for row in kept.tolist()}


def assert_same(points: LinePoints, twin: dict[int, Found], unit: float) -> None:
    assert points.rows.tolist() == list(twin)
    expected = list(twin.values())
    np.testing.assert_array_equal(points.columns, [f.column for f in expected])
    np.testing.assert_array_equal(points.sigma_px, np.array([f.sigma for f in expected], float))
    np.testing.assert_array_equal(points.width_px, np.array([f.width for f in expected], float))
    heights = np.array([f.height for f in expected], float)
    np.testing.assert_array_equal(points.peak, heights * unit)
    flags = [
        f.is_saturated * PointFlag.SATURATED
        | f.is_rival * PointFlag.RIVAL
        | f.is_narrow * PointFlag.NARROW
        for f in expected
    ]
    assert points.flags.tolist() == flags


CASES = [
    (PixelFormat.BGR, 8, False),
    (PixelFormat.BGR, 12, True),
    *((pattern, 8, False) for pattern in BAYER),
    (PixelFormat.BAYER_GRBG, 12, True),
    (PixelFormat.BAYER_BGGR, 12, True),
]


@pytest.mark.parametrize("kind", list(ColorKind))
@pytest.mark.parametrize(("pixel_format", "bits", "is_red"), CASES)
def test_same_bits_as_the_twin(
    device: str, pixel_format: PixelFormat, bits: int, is_red: bool, kind: ColorKind
) -> None:
    """Positions, sigmas, widths, heights and flags agree in every bit for every kind of frame."""
    on, off = hard_pair(pixel_format, bits, is_red)
    table = synthetic.table(kind, pixel_format.is_bayer, is_red)
    finder = LineFinder(table, (WIDTH, HEIGHT), pixel_format, bits, noise=NOISE, device=device)
    used_off = off if kind is ColorKind.DIFFERENCE else None
    points = finder.find(on, used_off)
    assert table.model.channel == (2 if is_red else 1)
    twin = by_twin(finder, on, used_off, table.model.channel, table.model.suppression)
    assert len(twin) > 15
    assert_same(points, twin, 255.0 / (2**bits - 1))


@pytest.mark.parametrize("pixel_format", [PixelFormat.BAYER_RGGB, PixelFormat.BAYER_GBRG])
@pytest.mark.parametrize("slope", [-0.8, -0.45, 0.45, 0.8])
@pytest.mark.parametrize("kind", list(ColorKind))
def test_same_bits_on_leaning_lines(
    device: str, pixel_format: PixelFormat, slope: float, kind: ColorKind
) -> None:
    """The second look along a leaning line agrees in every bit, to the frame's edges."""
    rng = np.random.default_rng(9)
    columns = synthetic.straight_columns(slope, HEIGHT, WIDTH)
    amplitude = rng.choice([90.0, 150.0, 250.0, 900.0], HEIGHT)
    lines = [synthetic.Line(columns, 1.2, amplitude)]
    on, off = synthetic.pair(lines, rng, pixel_format, width=WIDTH)
    table = synthetic.table(kind, is_mosaic=True)
    finder = LineFinder(table, (WIDTH, HEIGHT), pixel_format, noise=NOISE, device=device)
    used_off = off if kind is ColorKind.DIFFERENCE else None
    points = finder.find(on, used_off)
    twin = by_twin(finder, on, used_off, table.model.channel, table.model.suppression)
    assert len(twin) > 40
    assert_same(points, twin, 1.0)


def test_hard_frames_reach_every_branch() -> None:
    """The frames of the comparison hold saturated, narrow and doubtful points and empty rows."""
    on, off = hard_pair(PixelFormat.BGR, 8, False)
    table = synthetic.table(ColorKind.DIFFERENCE, False)
    points = LineFinder(table, (WIDTH, HEIGHT), PixelFormat.BGR).find(on, off)
    seen = int(np.bitwise_or.reduce(points.flags))
    assert seen == PointFlag.SATURATED | PointFlag.RIVAL | PointFlag.NARROW
    assert 0 < points.counts.empty < HEIGHT


@pytest.mark.parametrize("pixel_format", [PixelFormat.BGR, *BAYER])
@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("kind", list(ColorKind))
def test_mask_is_the_table_at_the_frames_colors(
    device: str, pixel_format: PixelFormat, bits: int, kind: ColorKind
) -> None:
    """The kernel's mask is the table looked up at each pixel's or cell's colour.

    Colours between two grey levels of 255 may round either way; they are next to none.
    """
    on, off = hard_pair(pixel_format, bits, is_red=False)
    table = synthetic.table(kind, pixel_format.is_bayer)
    finder = LineFinder(table, (WIDTH, HEIGHT), pixel_format, bits, device=device)
    finder.find(on, off)
    got: npt.NDArray[np.bool_] = finder.mask()
    expected = table.mask(on, off)
    assert got.shape == expected.shape
    assert 20 < expected.sum() < 0.8 * expected.size
    assert (got != expected).mean() <= (0.0 if bits == 8 else 0.002)


def test_the_kernels_logarithm_is_right() -> None:
    """The logarithm that the twin shares with the kernel agrees with the library's to 1e-15."""
    values = np.geomspace(1e-6, 1e6, 500)
    ours = [natural_log(float(value)) for value in values]
    np.testing.assert_allclose(ours, np.log(values), rtol=1e-14, atol=1e-15)
