"""The baked colour table against the exact posterior."""

from __future__ import annotations

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.laser import ColorKind, ColorTable, frame_colors
from tests.scanner.laser import synthetic


@pytest.mark.parametrize(("kind", "least"), [(ColorKind.LIT, 0.5), (ColorKind.DIFFERENCE, 0.9)])
def test_table_is_the_posterior_of_every_8_bit_color(kind: ColorKind, least: float) -> None:
    """On random whole colours and near the border of the classes the table is never wrong."""
    model = synthetic.table(kind, is_mosaic=False).model
    table = ColorTable(model, least)
    rng = np.random.default_rng(1)
    colors = rng.integers(0, 256, (8_000, 3))
    line = model.laser.means[rng.integers(0, 3, 8_000)] + rng.normal(0, 25, (8_000, 3))
    colors = np.concatenate([colors, np.clip(np.rint(line), 0, 255)])
    expected = model.posterior(colors) >= least
    assert 0.05 < expected.mean() < 0.95
    np.testing.assert_array_equal(table.contains(colors), expected)


def test_words_hold_64_neighbors() -> None:
    """The word is chosen by the upper 6 bits of blue, green and red, the bit by the lower 2."""
    table = synthetic.table(ColorKind.LIT, is_mosaic=False)
    assert table.words.shape == (262_144,)
    word = int(table.words[(40 << 12) | (60 << 6) | 20])
    corner = np.array([160, 240, 80])
    expected = [bool(word >> bit & 1) for bit in range(64)]
    offsets = [(bit >> 4, bit >> 2 & 3, bit & 3) for bit in range(64)]
    assert table.contains(corner + np.array(offsets)).tolist() == expected


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("pixel_format", [PixelFormat.BGR, PixelFormat.BAYER_BGGR])
@pytest.mark.parametrize("kind", list(ColorKind))
def test_table_agrees_on_frames(kind: ColorKind, pixel_format: PixelFormat, bits: int) -> None:
    """On rendered frames at least 99.9 % of the pixels are as the exact posterior has them."""
    table = synthetic.table(kind, pixel_format.is_bayer)
    rng = np.random.default_rng(2)
    line = synthetic.Line(synthetic.random_columns(rng, 400), 2.0, np.geomspace(30.0, 800.0, 400))
    on, off = synthetic.pair([line], rng, pixel_format, bits)
    used = off if kind is ColorKind.DIFFERENCE else None
    exact = table.model.posterior(frame_colors(on, used)) >= 0.5
    agreement = float((table.mask(on, used) == exact).mean())
    print(f"{pixel_format.value} {bits} bit {kind.value}: agreement {agreement:.4%}")
    assert exact.any()
    assert agreement >= 0.999


def test_refuses_what_makes_no_sense() -> None:
    """A probability of 1, and differences without an off frame."""
    table = synthetic.table(ColorKind.DIFFERENCE, is_mosaic=False)
    with pytest.raises(InputError, match="least_posterior"):
        ColorTable(table.model, 1.0)
    rng = np.random.default_rng(0)
    on, _ = synthetic.pair([synthetic.Line(synthetic.random_columns(rng))], rng)
    with pytest.raises(InputError, match="laser off"):
        table.mask(on)
