"""Colour models: posterior, file, and what they learn from frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorKind,
    GaussianMixture,
    LaserColorModel,
    fit_lit,
    fit_marked,
    fit_pairs,
    frame_colors,
)
from tests.scanner.laser import synthetic

FORMATS = [PixelFormat.BGR, PixelFormat.BAYER_GRBG]


def one_gaussian(mean: float, deviation: float) -> GaussianMixture:
    return GaussianMixture(np.ones(1), np.full((1, 3), mean), np.eye(3)[None] * deviation**2)


def simple_model(prior: float = 0.2) -> LaserColorModel:
    return LaserColorModel(one_gaussian(150, 10), one_gaussian(100, 10), prior, ColorKind.LIT, 1)


def learning_pair(pixel_format: PixelFormat) -> tuple[Frame, Frame, np.ndarray]:
    """Frames on and off with a line from weak to saturated, and where it is at least half."""
    rng = np.random.default_rng(4)
    columns = synthetic.random_columns(rng, 200)
    line = synthetic.Line(columns, amplitude=np.geomspace(40.0, 800.0, 200))
    on, off = synthetic.pair([line], rng, pixel_format)
    near = np.abs(np.arange(synthetic.WIDTH) - columns[:, None]) < 1.5
    return on, off, near


def test_posterior_is_bayes_rule() -> None:
    """Two Gaussians with a prior give the posterior of the formula; far away no overflow."""
    model = simple_model(0.2)
    colors = np.array([[150.0] * 3, [100.0] * 3, [125.0] * 3])
    likelihood = np.exp(-0.5 * 3 * (colors[:, 0] - [[150.0], [100.0]]) ** 2 / 100.0)
    expected = 0.2 * likelihood[0] / (0.2 * likelihood[0] + 0.8 * likelihood[1])
    np.testing.assert_allclose(model.posterior(colors), expected, rtol=1e-12)
    assert model.posterior([125.0] * 3) == pytest.approx(0.2)
    far = model.posterior([[1e5] * 3, [-1e5] * 3])
    np.testing.assert_allclose(far, [1.0, 0.0], atol=1e-300)


def test_file_gives_back_the_same_posterior(tmp_path: Path) -> None:
    """What is saved is loaded to the bit."""
    on, off, _ = learning_pair(PixelFormat.BGR)
    model = fit_pairs([(on, off)])
    model.save(tmp_path / "green.json")
    again = LaserColorModel.load(tmp_path / "green.json")
    colors = np.random.default_rng(0).uniform(0, 255, (100, 3))
    np.testing.assert_array_equal(model.posterior(colors), again.posterior(colors))
    assert (again.kind, again.channel, again.prior) == (model.kind, model.channel, model.prior)
    assert [path.name for path in tmp_path.iterdir()] == ["green.json"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "cake"}, "not a laser colour model"),
        ({"version": 99}, "version 99"),
        ({"prior": 2.0}, "prior"),
        ({"kind": "dark"}, "dark"),
        ({"laser": {"weights": [1.0]}}, "damaged"),
        ({"background": None}, "damaged"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, change: dict[str, object], words: str) -> None:
    """A file that is not what it says names itself and the trouble."""
    path = tmp_path / "model.json"
    simple_model().save(path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(FileFormatError, match=words) as error:
        LaserColorModel.load(path)
    assert "model.json" in str(error.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[1, 2]", b"{"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    """Bytes that are no model at all."""
    path = tmp_path / "model.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="not a laser colour model"):
        LaserColorModel.load(path)


def test_a_missing_file_is_the_callers_mistake(tmp_path: Path) -> None:
    """No such file: an input error, not a damaged model."""
    with pytest.raises(InputError, match=r"no\.json"):
        LaserColorModel.load(tmp_path / "no.json")


@pytest.mark.parametrize("pixel_format", FORMATS)
@pytest.mark.parametrize("way", ["pairs", "difference", "lit", "marked"])
def test_each_way_of_learning_knows_line_from_wall(pixel_format: PixelFormat, way: str) -> None:
    """Learned from a pair, a lit frame or marks, the model knows a new line from the wall."""
    on, off, near = learning_pair(pixel_format)
    model = {
        "pairs": lambda: fit_pairs([(on, off)], kind=ColorKind.LIT),
        "difference": lambda: fit_pairs([(on, off)]),
        "lit": lambda: fit_lit([on], "green"),
        "marked": lambda: fit_marked([on], [near]),
    }[way]()
    assert model.channel == 1
    assert model.kind is (ColorKind.DIFFERENCE if way == "difference" else ColorKind.LIT)
    rng = np.random.default_rng(9)
    columns = synthetic.straight_columns(0.02, 200)
    amplitude = np.geomspace(50.0, 900.0, 200)
    new_on, new_off = synthetic.pair([synthetic.Line(columns, 1.5, amplitude)], rng, pixel_format)
    used = new_off if way == "difference" else None
    is_line = model.posterior(frame_colors(new_on, used)) >= 0.5
    cell = 2 if pixel_format.is_bayer else 1
    middle = np.rint((columns[::cell] - 0.5 * (cell - 1)) / cell).astype(int)
    assert is_line[np.arange(len(middle)), middle].mean() > 0.99
    away = np.abs(np.arange(is_line.shape[1]) - middle[:, None]) > 8 / cell
    assert is_line[away].mean() < 0.001


def test_saturated_core_is_a_component_of_its_own() -> None:
    """The last component of the line holds what is saturated, seen or not."""
    rng = np.random.default_rng(4)
    columns = synthetic.random_columns(rng, 200)
    for amplitude in (120.0, 900.0):
        pair = synthetic.pair([synthetic.Line(columns, 1.5, amplitude)], rng)
        model = fit_pairs([pair], kind=ColorKind.LIT)
        assert model.laser.means[-1, 1] > 245.0
        assert model.posterior([250.0, 255.0, 130.0]) > 0.5


@pytest.mark.parametrize(
    ("others", "expected"), [((100.0, 100.0), 1.0), ((100.0, 220.0), 0.5), ((90.0, 300.0), 0.2857)]
)
def test_suppression_keeps_the_core_bright(others: tuple[float, float], expected: float) -> None:
    """The more the other channels shine in the core, the less of them may be taken away."""
    body, core = [others[0], 140.0, others[0]], [others[1], 200.0, others[1]]
    laser = GaussianMixture(np.array([0.5, 0.5]), np.array([body, core]), np.stack([np.eye(3)] * 2))
    model = LaserColorModel(laser, one_gaussian(50, 9), 0.01, ColorKind.LIT, 1)
    assert model.suppression == pytest.approx(expected, abs=1e-3)


def test_mosaic_cells_are_colors_without_demosaicing() -> None:
    """A cell's colour is its blue site, the mean of its greens, its red; odd borders are left."""
    pixels = np.arange(5 * 7, dtype=np.uint16).reshape(5, 7) * 100
    frame = Frame(pixels, PixelFormat.BAYER_GRBG, 12, 1.0, 0.0, 0, None, 0)
    colors = frame_colors(frame)
    assert colors.shape == (2, 3, 3)
    blue, green, red = pixels[1, 0], (pixels[0, 0] + pixels[1, 1]) / 2, pixels[0, 1]
    np.testing.assert_allclose(colors[0, 0], np.array([blue, green, red]) * 255 / 4095)


def test_differences_below_zero_are_black() -> None:
    """Noise that makes the lit frame darker than the off frame gives 0."""
    on = Frame(np.full((4, 4, 3), 10, np.uint8), PixelFormat.BGR, 8, 1.0, 0.0, 0, None, 0)
    off = Frame(np.full((4, 4, 3), 30, np.uint8), PixelFormat.BGR, 8, 1.0, 0.0, 0, None, 0)
    assert (frame_colors(on, off) == 0).all()


def test_bad_frames_and_parameters_are_refused() -> None:
    """Mono frames, unlike pairs, no line, wrong masks, an unknown colour, a prior of 1."""
    on, off, near = learning_pair(PixelFormat.BGR)
    mono = Frame(np.zeros((9, 9), np.uint8), PixelFormat.MONO, 8, 1.0, 0.0, 0, None, 0)
    small = Frame(off.pixels[:50], PixelFormat.BGR, 8, 1.0, 0.0, 0, None, 0)
    with pytest.raises(InputError, match="mono"):
        frame_colors(mono)
    with pytest.raises(InputError, match="same shape"):
        fit_pairs([(on, small)])
    with pytest.raises(InputError, match="laser is on"):
        fit_pairs([(off, off)])
    with pytest.raises(InputError, match="stands out"):
        fit_lit([on], "red")
    with pytest.raises(InputError, match="booleans of shape"):
        fit_marked([on], [near[:5]])
    with pytest.raises(InputError, match="channel"):
        fit_lit([on], "pink")
    with pytest.raises(InputError, match="prior"):
        fit_pairs([(on, off)], prior=1.0)
