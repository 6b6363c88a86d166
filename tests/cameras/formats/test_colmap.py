"""COLMAP models: its documentation's formulas, round trips as text and binary, folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras.formats import colmap
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError, LensDomainWarning

MODELS = {
    "SIMPLE_PINHOLE": (500.5, 320.25, 240.75),
    "PINHOLE": (500.5, 510.0, 320.25, 240.75),
    "SIMPLE_RADIAL": (500.5, 320.25, 240.75, -0.05),
    "RADIAL": (500.5, 320.25, 240.75, -0.05, 0.02),
    "OPENCV": (500.5, 510.0, 320.25, 240.75, -0.05, 0.02, 1e-3, -2e-3),
    "FULL_OPENCV": (
        *(500.5, 510.0, 320.25, 240.75, -0.05, 0.02, 1e-3, -2e-3),
        *(0.01, 0.02, -0.01, 0.005),
    ),
    "SIMPLE_FISHEYE": (300.5, 320.25, 240.75),
    "FISHEYE": (300.5, 310.0, 320.25, 240.75),
    "SIMPLE_RADIAL_FISHEYE": (300.5, 320.25, 240.75, -0.02),
    "RADIAL_FISHEYE": (300.5, 320.25, 240.75, -0.02, 0.003),
    "OPENCV_FISHEYE": (300.5, 310.0, 320.25, 240.75, -0.02, 0.003, 1e-3, -1e-4),
}


def colmap_projection(model: str, parameters: tuple[float, ...], points: np.ndarray) -> np.ndarray:
    """Pixels of points in the camera's optical axes, by the formulas of COLMAP's documentation."""
    u, v = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if model in ("PINHOLE", "OPENCV", "FULL_OPENCV", "FISHEYE", "OPENCV_FISHEYE"):
        fx, fy, cx, cy, *extra = parameters
    else:
        f, cx, cy, *extra = parameters
        fx = fy = f
    k = [*extra, 0, 0, 0, 0, 0, 0, 0, 0]
    if "FISHEYE" in model:
        r = np.hypot(u, v)
        theta = np.arctan(r)
        bent = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
        x, y = u * bent / r, v * bent / r
    else:
        square = u * u + v * v
        k1, k2, p1, p2, k3, k4, k5, k6, *_ = k
        radial = (1 + k1 * square + k2 * square**2 + k3 * square**3) / (
            1 + k4 * square + k5 * square**2 + k6 * square**3
        )
        x = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
        y = v * radial + 2 * p2 * u * v + p1 * (square + 2 * v * v)
    return np.stack([fx * x + cx, fy * y + cy], axis=1)


def text_model(folder: Path, cameras: str, images: str | None) -> Path:
    (folder / "cameras.txt").write_text(cameras)
    if images is not None:
        (folder / "images.txt").write_text(images)
    return folder


def some_rig() -> Rig:
    """Every lens that COLMAP has, shared lenses, names with folders and accents."""
    rng = np.random.default_rng(4)
    poses = [
        dw.Pose.from_orientation(rng.uniform(-100, 100, 3), rng.uniform(-180, 180, 3), frame)
        for frame in ("world", "rotated") * 4
    ]
    numbers = (501.1, 499.7, 320.3, 239.9, 640, 480)
    tangential = (-0.05, 0.02, 1e-3, -2e-3)
    return Rig.of(
        {
            "left/a.png": dw.PinholeCamera(*numbers, poses[0]),
            "left/b.png": dw.PinholeCamera(*numbers, poses[1]),
            "ü.png": dw.PinholeCamera(*numbers, poses[2], tangential),
            "five.png": dw.PinholeCamera(*numbers, poses[3], (*tangential, 0.01)),
            "full.png": dw.PinholeCamera(
                *numbers, poses[4], (*tangential, 0.01, 0.02, -0.01, 5e-3)
            ),
            "#1": dw.FisheyeCamera(*numbers, poses[5], (-0.02, 0.003, 1e-3, -1e-4)),
            "again": dw.PinholeCamera(*numbers, poses[6]),
        }
    )


def assert_same_rig(found: Rig, expected: Rig) -> None:
    assert found.names == expected.names
    for name in expected:
        one, other = found[name], expected[name]
        assert type(one) is type(other)
        assert one.size == other.size
        np.testing.assert_allclose(one.K, other.K, rtol=0, atol=1e-12)
        assert one.distortion == other.distortion
        np.testing.assert_allclose(one.pose.rotation, other.pose.rotation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            one.pose.center_world, other.pose.center_world, rtol=0, atol=1e-12
        )


@pytest.mark.parametrize("model", MODELS)
def test_every_model_projects_as_documented(tmp_path: Path, model: str) -> None:
    """A model written by hand: pixels are COLMAP's less a half, for every camera model."""
    rng = np.random.default_rng(1)
    axis = np.array([0.36, 0.48, -0.8])
    rotation, quaternion = cv2.Rodrigues(1.2 * axis)[0], [np.cos(0.6), *(np.sin(0.6) * axis)]
    translation = np.array([1.5, -2.25, 3.125])
    seen = rng.uniform((-1, -0.8, 1), (1, 0.8, 4), (200, 3)) * [2, 2, 1]
    points_world = (seen - translation) @ rotation
    numbers = " ".join(map(repr, map(float, [*quaternion, *translation])))
    parameters = " ".join(map(repr, MODELS[model]))
    folder = text_model(
        tmp_path, f"# c\n7 {model} 640 480 {parameters}\n", f"3 {numbers} 7 one.png\n\n"
    )
    camera = colmap.read_rig(folder)["one.png"]
    u, v, depth, _ = camera.project(points_world, "z")
    assert np.isfinite(u).all()
    expected = colmap_projection(model, MODELS[model], seen) - 0.5
    np.testing.assert_allclose(np.stack([u, v], axis=1), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(depth, seen[:, 2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["", "cameras.txt", "images.txt", "cameras.bin", "images.bin"])
def test_models_come_back(tmp_path: Path, name: str) -> None:
    """Written and read as text and binary: names, order, lenses and poses, to 1e-12."""
    rig = some_rig()
    colmap.write_rig(rig, tmp_path / "sparse" / name if name else tmp_path / "sparse")
    suffix = name[-4:] or ".txt"
    there = sorted(entry.name for entry in (tmp_path / "sparse").iterdir())
    assert there == [f"{part}{suffix}" for part in ("cameras", "images", "points3D")]
    for path in (tmp_path / "sparse", tmp_path / "sparse" / f"images{suffix}"):
        assert colmap.matches(path)
        assert_same_rig(colmap.read_rig(path), rig)
    # Its own work may be written again.
    colmap.write_rig(rig, tmp_path / "sparse")


def test_equal_lenses_are_one_camera(tmp_path: Path) -> None:
    """Three of the seven share a lens: five cameras in the file, seven images."""
    colmap.write_rig(some_rig(), tmp_path)
    text = (tmp_path / "cameras.txt").read_text()
    assert "# Number of cameras: 5\n" in text
    models = [line.split()[:2] for line in text.splitlines() if not line.startswith("#")]
    names = ["PINHOLE", "OPENCV", "FULL_OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"]
    assert models == [[str(number), name] for number, name in enumerate(names, start=1)]


def test_cameras_alone_stand_at_the_origin(tmp_path: Path) -> None:
    """Without images the cameras are named by number, their optical axes are the world's."""
    cameras = "3 SIMPLE_PINHOLE 640 480 500 320 240\n12 PINHOLE 64 48 50 50 32 24\n"
    rig = colmap.read_rig(text_model(tmp_path, cameras, None))
    assert rig.names == ("3", "12")
    np.testing.assert_array_equal(rig["3"].pose.optical_from_world, np.eye(4))
    assert (rig["3"].cx, rig["3"].cy) == (319.5, 239.5)


def test_binary_is_read_where_both_are(tmp_path: Path) -> None:
    """A folder with both forms is read as COLMAP does: binary first; a file's name decides."""
    colmap.write_rig(some_rig(), tmp_path / "cameras.bin")
    text_model(tmp_path, "3 SIMPLE_PINHOLE 640 480 500 320 240\n", "1 1 0 0 0 0 0 0 3 t.png\n")
    assert colmap.read_rig(tmp_path).names == some_rig().names
    assert colmap.read_rig(tmp_path / "cameras.txt").names == ("t.png",)


def test_a_lens_that_folds_warns_once(tmp_path: Path) -> None:
    """The domain is looked at once a lens, however many images share it."""
    images = "".join(f"{k} 1 0 0 0 0 0 0 3 {k}.png\n\n" for k in range(3))
    folder = text_model(tmp_path, "3 SIMPLE_RADIAL 640 480 300 320 240 -0.5\n", images)
    with pytest.warns(LensDomainWarning) as caught:
        colmap.read_rig(folder)
    assert len(caught) == 1


@pytest.mark.parametrize(
    "name", ["cameras.bin", "images.bin", "points3D.txt", "rigs.txt", "frames.bin"]
)
def test_another_model_is_not_written_over(tmp_path: Path, name: str) -> None:
    """Points that would be lost, or files that would be read in place of ours: refused, kept."""
    (tmp_path / name).write_bytes(b"1 2 3 4 5 6 7 8 and more of it")
    with pytest.raises(InputError, match=f"it holds {name}, .* choose an empty folder"):
        colmap.write_rig(some_rig(), tmp_path / "cameras.txt")
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (dw.EquirectangularCamera.looking((64, 32)), "'x' cannot be .* EquirectangularCamera"),
        (
            dw.PinholeCamera.from_matrix(
                [[500, 0, 320], [0, 500, 240], [0, 0, 1]], (640, 480), [0] * 8 + [1e-4, 0, 0, 0]
            ),
            "PinholeCamera with thin prism or tilt",
        ),
    ],
)
def test_lenses_without_a_model_are_refused(
    tmp_path: Path, camera: dw.Camera, message: str
) -> None:
    """A lens that COLMAP has no model for: an error with the camera's name, and no folder."""
    with pytest.raises(InputError, match=message):
        colmap.write_rig(Rig.of({"x": camera}), tmp_path / "sparse")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", " a", "a b", "a\nb", "a\0b"])
def test_names_that_text_cannot_hold_are_refused(tmp_path: Path, name: str) -> None:
    """COLMAP cuts names in images.txt at white space: refused, with nothing written."""
    camera = dw.PinholeCamera.from_fov((60, 45), (64, 48))
    with pytest.raises(InputError, match="COLMAP cuts names in images.txt at white space"):
        colmap.write_rig(Rig.of({name: camera}), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [" a", "a b", "a\nb"])
def test_binary_holds_names_with_white_space(tmp_path: Path, name: str) -> None:
    """In images.bin a name ends at a zero, so white space comes back."""
    camera = dw.PinholeCamera.from_fov((60, 45), (64, 48))
    colmap.write_rig(Rig.of({name: camera}), tmp_path / "cameras.bin")
    assert colmap.read_rig(tmp_path).names == (name,)


@pytest.mark.parametrize("name", ["", "a\0b", "ü" * 2049])
def test_names_that_binary_cannot_hold_are_refused(tmp_path: Path, name: str) -> None:
    """Empty names, zeros and more than 4096 bytes cannot come back."""
    camera = dw.PinholeCamera.from_fov((60, 45), (64, 48))
    with pytest.raises(InputError, match="a name in images.bin has from 1 to 4096 bytes"):
        colmap.write_rig(Rig.of({name: camera}), tmp_path / "cameras.bin")


@pytest.mark.parametrize("name", ["model.txt", "there", "no/where"])
def test_bad_targets_are_refused(tmp_path: Path, name: str) -> None:
    """A file that is no model's, a file in the folder's place, a missing parent."""
    (tmp_path / "there").write_text("x")
    with pytest.raises(InputError, match="cannot write"):
        colmap.write_rig(some_rig(), tmp_path / name)


@pytest.mark.parametrize(
    ("cameras", "images", "message"),
    [
        ("1 PINHOLE 9 9 5 5 4 4\n1 PINHOLE 9 9 5 5 4 4\n", None, "two cameras have the number 1"),
        ("# none\n", None, "cameras.txt: no camera in it"),
        ("1 PINHOLE 9 9 5 5 4 4\n", "# none\n", "images.txt: no image in it"),
        ("1 PINHOLE 9 9 0 5 4 4\n", None, "cameras.txt: camera 1: fx must be"),
        ("1 PINHOLE 0 9 5 5 4 4\n", None, "cameras.txt: camera 1: size must be"),
        (
            "1 PINHOLE 9 9 5 5 4 4\n",
            "1 1 0 0 0 0 0 0 1 a\n\n2 1 0 0 0 0 0 0 1 a\n\n",
            "images.txt: two images have the name 'a'",
        ),
        (
            "1 PINHOLE 9 9 5 5 4 4\n",
            "1 1 0 0 0 0 0 0 2 a\n",
            "image 'a' is of camera 2, which cameras.txt does not have",
        ),
        (
            "1 PINHOLE 9 9 5 5 4 4\n",
            "1 1 0 0 0.1 0 0 0 1 a\n",
            "images.txt: image 'a': quaternion must have length 1 within 0.001, .* length 1.00499",
        ),
    ],
)
def test_models_that_contradict_themselves_are_refused(
    tmp_path: Path, cameras: str, images: str | None, message: str
) -> None:
    """Doubled numbers and names, absent cameras, impossible lenses: the error says which."""
    with pytest.raises(FileFormatError, match=message):
        colmap.read_rig(text_model(tmp_path, cameras, images))


def test_images_without_cameras_are_refused(tmp_path: Path) -> None:
    """images.txt alone has no lens: the error names the missing file."""
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a\n\n")
    assert not colmap.matches(tmp_path)
    with pytest.raises(FileFormatError, match=r"there is no cameras\.txt"):
        colmap.read_rig(tmp_path / "images.txt")
