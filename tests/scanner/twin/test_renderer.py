"""The picture: surfaces, mosaic, noise, speckle, and the same bits every time."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.geometry import Lens, reference_geometry
from depthwarp.scanner.room import Box, Room, furnished_room
from depthwarp.scanner.twin import (
    Laser,
    Scene,
    Sensor,
    Shot,
    TwinRenderer,
    board_pose,
    chessboard,
    wall_scene,
)
from depthwarp.scanner.twin.rays import pixel_rays
from tests.scanner.twin.lines import CLEAN, line_light

QUARTER = reference_geometry(0.25)
PAPER = (1.79, 3.3, 1.2)
BAYER = [format_ for format_ in PixelFormat if format_.is_bayer]


def test_rays_undo_the_lens() -> None:
    """The ray of every pixel projects back into the pixel's middle, up to the corners."""
    for scale in (0.25, 1.0):
        lens = reference_geometry(scale).lens
        slopes = pixel_rays(lens).slopes[::19, ::13].astype(np.float64)
        ahead = np.dstack([slopes, np.ones(slopes.shape[:2])]).reshape(-1, 3)
        pixels, _ = cv2.projectPoints(
            ahead, np.zeros(3), np.zeros(3), lens.K, np.array(lens.distortion)
        )
        rows, columns = np.mgrid[0 : lens.size[1] : 19, 0 : lens.size[0] : 13]
        expected = np.stack([columns, rows], axis=-1).reshape(-1, 2)
        assert np.abs(pixels.reshape(-1, 2) - expected).max() < 1e-3


@pytest.mark.parametrize("angle", [0.0, 137.0, 290.0])
def test_surfaces_are_those_of_a_float64_cast(device: str, angle: float) -> None:
    """Every pixel sees the surface, at the distance, that the room's own ray cast finds."""
    board = chessboard(8, 5, 0.06, board_pose((2.5, 3.4, 1.3), PAPER))
    scene = Scene(furnished_room(), (board,))
    renderer = TwinRenderer(scene, QUARTER, PAPER, device=device)
    depth, surface = renderer.surfaces(angle)
    pick = np.random.default_rng(1).permutation(depth.size)[:6000]
    slopes = pixel_rays(QUARTER.lens).slopes.reshape(-1, 2)[pick].astype(np.float64)
    rays = np.hstack([slopes, np.ones((len(slopes), 1))])
    length = np.linalg.norm(rays, axis=1)
    rotation, camera = renderer.placement.world_from_optical(angle)
    distance, expected = scene.cast(camera, rays / length[:, None] @ rotation.T)
    same = surface.ravel()[pick] == expected
    assert same.mean() > 0.998  # rays through an edge may fall to either side
    hit = same & (expected >= 0)
    np.testing.assert_allclose(depth.ravel()[pick][hit], (distance / length)[hit], rtol=2e-5)


def test_same_shot_same_bits(device: str) -> None:
    """A shot has the same bits again after others and in another renderer; a new number has not."""
    settings = {"laser": Laser(speckle=0.3), "seed": 5, "device": device}
    scene = Scene(furnished_room())
    first, second = (TwinRenderer(scene, QUARTER, PAPER, **settings) for _ in range(2))
    wanted = first.render(Shot(10.0))
    first.render(Shot(20.0, False, 500.0, 3.0, 7))
    np.testing.assert_array_equal(first.render(Shot(10.0)), wanted)
    np.testing.assert_array_equal(second.render(Shot(10.0)), wanted)
    same = Shot(np.float64(10.0) + 1e-9, True, 2000)  # as an axis might report it
    np.testing.assert_array_equal(first.render(same), wanted)
    assert (first.render(Shot(10.0, number=1)) != wanted).mean() > 0.3
    other = TwinRenderer(scene, QUARTER, PAPER, **{**settings, "seed": 6})
    assert (other.render(Shot(10.0)) != wanted).mean() > 0.3


@pytest.mark.parametrize("pixel_format", BAYER)
def test_mosaic_takes_its_colours_from_the_picture(pixel_format: PixelFormat) -> None:
    """Each pixel of a mosaic is the channel of the BGR picture that the format's name says."""
    scene = wall_scene(1.0, (220, 120, 40))
    bgr = TwinRenderer(scene, QUARTER, sensor=Sensor(PixelFormat.BGR).quiet()).render(Shot(0.0))
    mosaic = TwinRenderer(scene, QUARTER, sensor=Sensor(pixel_format).quiet()).render(Shot(0.0))
    assert len(np.unique(bgr[0, 0])) == 3
    for site, letter in enumerate(pixel_format.value[-4:]):
        rows, columns = slice(site // 2, None, 2), slice(site % 2, None, 2)
        channel = {"b": 0, "g": 1, "r": 2}[letter]
        np.testing.assert_array_equal(mosaic[rows, columns], bgr[rows, columns, channel])


@pytest.mark.parametrize(
    ("read", "full_well", "gain"), [(2.5, np.inf, 0), (0, 4000, 0), (1, 4000, 6)]
)
def test_noise_has_the_stated_variance(read: float, full_well: float, gain: float) -> None:
    """Noise has no mean, and the variance of read noise plus shot noise."""
    sensor = Sensor(PixelFormat.BGR, 12, read, full_well)
    scene = wall_scene(3.0, (200, 200, 200))
    noisy = TwinRenderer(scene, QUARTER, sensor=sensor).render(Shot(0.0, False, 8000.0, gain))
    clean = TwinRenderer(scene, QUARTER, sensor=CLEAN).render(Shot(0.0, False, 8000.0, gain))
    level = clean[0, 0, 0] / 65535 * 255
    values = noisy / 4095 * 255
    assert 30 < level < 140
    assert values.mean() == pytest.approx(level, abs=0.02)
    wanted = read**2 + level * 255 / full_well * 10 ** (gain / 20)
    assert values.var() == pytest.approx(wanted, rel=0.02)
    channels = np.corrcoef(values.reshape(-1, 3).T)
    assert np.abs(channels - np.eye(3)).max() < 0.01


def test_speckle_has_the_stated_contrast_and_stays() -> None:
    """Speckle has mean 1 and the stated contrast; it is the same in every shot at an angle."""
    clean, grainy = (
        TwinRenderer(wall_scene(1.0), QUARTER, laser=laser, sensor=CLEAN)
        for laser in (Laser(1.0, 0.05, 0.0), Laser(1.0, 0.05, 0.0, speckle=0.3))
    )
    plain, speckled = line_light(clean, 0.0, 60.0), line_light(grainy, 0.0, 60.0)
    ratio = speckled[plain > 20] / plain[plain > 20]
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert ratio.std() == pytest.approx(0.3, rel=0.03)
    again = grainy.render(Shot(0.0, True, 60.0, number=3))
    np.testing.assert_array_equal(again, grainy.render(Shot(0.0, True, 60.0)))


@pytest.mark.parametrize(("bits", "dtype", "most"), [(8, np.uint8, 255), (12, np.uint16, 4095)])
def test_full_scale(bits: int, dtype: type, most: int) -> None:
    """A saturated pixel has the greatest number that the bits hold."""
    sensor = Sensor(PixelFormat.BAYER_RGGB, bits)
    pixels = TwinRenderer(wall_scene(1.0), QUARTER, sensor=sensor).render(Shot(0.0, True, 1e5))
    assert pixels.dtype == dtype and pixels.max() == most


def test_open_air_is_brighter_than_black() -> None:
    """A ray that meets nothing sees the sky, without laser."""
    board = chessboard(8, 5, 0.01, board_pose((3.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    renderer = TwinRenderer(Scene(Room(()), (board,)), QUARTER, sensor=CLEAN)
    lit, dark = (renderer.render(Shot(0.0, on))[0] for on in (True, False))
    np.testing.assert_array_equal(lit, dark)
    assert (dark > 0).all()


def test_bad_settings_are_refused() -> None:
    """Each value out of its range is refused with its name."""
    for make, name in (
        (lambda: Laser(fan=180.0), "fan"),
        (lambda: Laser(waist=0.0), "waist"),
        (lambda: Laser(speckle=-0.1), "speckle"),
        (lambda: Laser(response=(1.0, float("nan"), 0.0)), "response"),
        (lambda: Sensor(PixelFormat.MONO), "pixel_format"),
        (lambda: Sensor(bits=17), "bits"),
        (lambda: Sensor(full_well=0.0), "full_well"),
        (lambda: Sensor(read_noise=float("nan")), "read_noise"),
        (lambda: Shot(float("nan")), "angle"),
        (lambda: Shot(0.0, True, 0.0), "exposure_us"),
        (lambda: Shot(0.0, number=-1), "number"),
        (lambda: Scene(Room(())), "box or board"),
        (lambda: Scene(furnished_room(), ambient=-1.0), "ambient"),
        (lambda: TwinRenderer(wall_scene(1.0), QUARTER, seed=-1), "seed"),
        (lambda: TwinRenderer(wall_scene(1.0), QUARTER, (0.0, 0.0, float("inf"))), "position"),
    ):
        with pytest.raises(InputError, match=name):
            make()


def test_head_inside_a_solid_is_refused() -> None:
    """A head that stands inside furniture is told so, with where."""
    renderer = TwinRenderer(Scene(furnished_room()), QUARTER, (1.85, 7.05, 0.73))
    with pytest.raises(InputError, match="inside a solid"):
        renderer.render(Shot(0.0))


def test_refused_angle_leaves_no_trace() -> None:
    """After an angle at which the camera would stand in a wall, the last angle is as before."""
    wall = Box("wall", (0.0, -0.9, 0.0), (4.0, 1.0, 4.0), (200, 200, 200))
    renderer = TwinRenderer(Scene(Room((wall,))), QUARTER)
    wanted = renderer.render(Shot(-90.0))
    with pytest.raises(InputError, match="the camera stands inside"):
        renderer.render(Shot(180.0))
    np.testing.assert_array_equal(renderer.render(Shot(-90.0)), wanted)


def test_lens_that_folds_back_is_refused() -> None:
    """A distortion that cannot be undone in the corners is refused."""
    lens = Lens(300.0, 300.0, 199.5, 299.5, (400, 600), (-0.6, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="folds back"):
        pixel_rays(lens)
