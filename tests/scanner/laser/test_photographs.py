"""The line in real photographs: green and red lasers, four cameras; skipped where they are not."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorKind,
    ColorTable,
    LineFinder,
    LinePoints,
    LineStatus,
    PointFlag,
    fit_lit,
    fit_marked,
    fit_pairs,
    frame_colors,
)

BOARD = "hjamal3+Light-Stripe-Calibration"
CLUTTER = "mkoroknai+laser_line_scanner"
BEAR = "francisengelmann+FabScan100"
TWO_LASERS = "IljaRukin+3D_line_laser_scanner"
LIT_ROOM = "jzx-gooner+Structured-Light-Scanner"


@pytest.fixture(scope="module")
def photographs(request: pytest.FixtureRequest) -> Path:
    """The folder of photographs beside the real scans."""
    shared: Path = request.getfixturevalue("shared_data")
    folder = shared.parent / "laser_images"
    if not folder.is_dir():
        pytest.skip(f"no laser photographs on this machine: there is no folder {folder}")
    return folder


def photograph(path: Path, quarter_turns: int = 0) -> Frame:
    pixels = cv2.imread(str(path))
    assert pixels is not None
    turned = np.rot90(pixels, quarter_turns).astype(np.uint8)
    return Frame(turned, PixelFormat.BGR, 8, float("nan"), float("nan"), 0, None, 0)


@cache
def board_table(folder: Path) -> ColorTable:
    """Learned from one photograph of the board, told no more than that the laser is green."""
    return ColorTable(fit_lit([photograph(folder / BOARD / "0_right.jpg")], "green"))


def find(table: ColorTable, frame: Frame, off: Frame | None = None) -> LinePoints:
    height, width = frame.pixels.shape[:2]
    return LineFinder(table, (width, height), frame.pixel_format).find(frame, off)


def roughness(points: LinePoints) -> float:
    """Median distance of a point from the middle of its two neighbours [px]."""
    c = points.columns
    return float(np.median(np.abs(c[1:-1] - (c[:-2] + c[2:]) / 2)))


@pytest.mark.parametrize("name", ["0_right", "1_right", "2_right", "3_right", "4_right", "5_right"])
def test_line_on_the_board(photographs: Path, name: str) -> None:
    """Learned on one view, the line is found on the board of all six: continuous and smooth."""
    points = find(board_table(photographs), photograph(photographs / BOARD / f"{name}.jpg"))
    assert points.check().status is LineStatus.FOUND
    assert points.counts.found > 0.78 * points.counts.total  # above the board there is none
    steps = np.abs(np.diff(points.columns)) / np.diff(points.rows)
    assert (steps < 1.0).mean() > 0.99
    assert roughness(points) < 0.08
    assert 3.0 < np.median(points.width_px) < 6.0


@pytest.mark.parametrize("name", ["0_right", "1_right", "4_right"])
def test_line_on_the_board_is_straight(photographs: Path, name: str) -> None:
    """On the flat board the line bends by the lens alone: 0.3 px RMS off a parabola."""
    points = find(board_table(photographs), photograph(photographs / BOARD / f"{name}.jpg"))
    on_board = (points.rows > 130) & (points.rows < 370)
    rows, columns = points.rows[on_board], points.columns[on_board]
    residual = columns - np.polyval(np.polyfit(rows, columns, 2), rows)
    assert on_board.sum() > 235
    assert np.sqrt(np.mean(residual**2)) < 0.3


def test_table_agrees_with_the_posterior(photographs: Path) -> None:
    """The table is the exact posterior at 0.5 on at least 99.9 % of the pixels."""
    table = board_table(photographs)
    for path in (f"{BOARD}/1_right.jpg", f"{CLUTTER}/test_rotation_frame.jpg"):
        frame = photograph(photographs / path)
        exact = table.model.posterior(frame_colors(frame)) >= 0.5
        assert (table.mask(frame) == exact).mean() >= 0.999


def test_saturated_core_of_another_camera(photographs: Path) -> None:
    """Where the line is white the points are in its middle, not on its green flanks."""
    frame = photograph(photographs / CLUTTER / "test_rotation_frame.jpg")
    points = find(board_table(photographs), frame)
    assert points.counts.found > 0.75 * points.counts.total
    on_figure = (points.rows > 310) & (points.rows < 370)
    assert (points.flags[on_figure] & PointFlag.SATURATED != 0).all()
    assert roughness(points) < 0.1
    for row, column in zip(points.rows[on_figure], points.columns[on_figure], strict=True):
        white = np.flatnonzero(frame.pixels[row].min(axis=1) > 200)
        core = white[np.abs(white - column) < 12]
        assert abs(core.mean() - column) < 1.0


@pytest.mark.parametrize("name", ["test_depth00.png", "test_depth03.jpg"])
def test_lines_across_when_turned_upright(photographs: Path, name: str) -> None:
    """The same camera's lines across the picture, turned by a quarter: nearly every row."""
    frame = photograph(photographs / CLUTTER / name, quarter_turns=1)
    points = find(board_table(photographs), frame)
    assert points.counts.found > 0.95 * points.counts.total
    assert roughness(points) < 0.15


@cache
def bear_table(folder: Path, kind: ColorKind) -> ColorTable:
    """Learned from the pair alone."""
    return ColorTable(fit_pairs([bear_pair(folder)], kind=kind))


def bear_pair(folder: Path) -> tuple[Frame, Frame]:
    on, off = (photograph(folder / BEAR / f"laser_{state}.jpg") for state in ("on", "off"))
    return on, off


@pytest.mark.parametrize("kind", list(ColorKind))
def test_red_pair(photographs: Path, kind: ColorKind) -> None:
    """A red laser from an on/off pair alone: wall and bear, where it is within 45 degrees."""
    on, off = bear_pair(photographs)
    table = bear_table(photographs, kind)
    assert table.model.channel == 2
    points = find(table, on, off)
    upper = points.rows < 800  # below it runs flat over the floor
    assert upper.sum() > 0.93 * 800
    assert (points.flags[upper] & PointFlag.SATURATED != 0).mean() > 0.9
    steps = np.abs(np.diff(points.columns[upper]))
    assert np.median(steps) < 0.6
    assert (steps < 4.0).mean() > 0.98


def test_pair_and_single_frame_agree(photographs: Path) -> None:
    """With and without the off frame the red line is at the same columns to 0.3 px."""
    on, off = bear_pair(photographs)
    table = bear_table(photographs, ColorKind.LIT)
    with_off, without = find(table, on, off), find(table, on)
    rows, i, j = np.intersect1d(with_off.rows, without.rows, return_indices=True)
    upper = rows < 800
    assert upper.sum() > 0.9 * 800
    difference = with_off.columns[i] - without.columns[j]
    assert np.median(np.abs(difference[upper])) < 0.3


def test_overexposed_line_in_a_lit_room(photographs: Path) -> None:
    """A red line so bright that it is white, on white paper and wood: found where it is marked.

    There is no red to learn from, so the colour alone cannot do it without marks.
    """
    frame = photograph(photographs / LIT_ROOM / "test.jpg")
    points = find(ColorTable(fit_marked([frame], [frame.pixels[..., 2] > 240])), frame)
    assert points.check().counts.found > 0.85 * points.counts.total
    assert roughness(points) < 0.3
    on_table = points.rows > 800
    assert on_table.sum() > 0.85 * 212
    straight = np.polyfit(points.rows[on_table], points.columns[on_table], 1)
    residual = points.columns[on_table] - np.polyval(straight, points.rows[on_table])
    assert np.median(np.abs(residual)) < 2.0


def test_two_lasers_make_doubtful_rows(photographs: Path) -> None:
    """Where both lasers of the dark scanner are apart, rows have rivals; below they are one."""
    frame = photograph(photographs / TWO_LASERS / "calibration.jpg")
    points = find(ColorTable(fit_lit([frame], "red")), frame)
    rival = points.flags & PointFlag.RIVAL != 0
    upper, middle = points.rows < 250, (points.rows > 700) & (points.rows < 1700)
    assert rival[upper].mean() > 0.25
    assert rival[middle].mean() < 0.05
    assert middle.sum() > 0.97 * 999
