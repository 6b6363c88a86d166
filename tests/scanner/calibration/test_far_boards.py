"""Small, far boards that nearly face the camera: two poses explain one view alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    BoardView,
    Chessboard,
    calibrate_lens,
    calibrate_turning_axis,
    calibrate_views,
)
from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.views import board_pose
from depthwarp.scanner.frames import PixelFormat, SourceInfo
from depthwarp.scanner.geometry import reference_geometry
from tests.scanner.calibration.synthetic import BOARD, PLACES, Place, board_at, see, tilted

TRUTH = tilted(reference_geometry())
CAMERA = SourceInfo("synthetic", "S-1", TRUTH.lens.size, PixelFormat.MONO, True)
SMALL = Chessboard(5, 4, 0.04)
TILT_DEG = 5.0
FAR = 9  # the small board's placement


def facing(depth: float, tilt_deg: float) -> Place:
    """On the laser line, leaning by an angle from square to the line of sight."""
    x = float((TRUTH.plane_distance - TRUTH.plane_normal[2] * depth) / TRUTH.plane_normal[0])
    return Place((x, 0.0, depth), (tilt_deg, float(np.degrees(np.arctan2(x, depth))), 0.0))


FAR_PLACE = facing(2.5, TILT_DEG)


def views(seed: int) -> tuple[list[BoardView], list[BoardView]]:
    """Large boards nearby, and the small one seen from several motor angles."""
    near = see(TRUTH, np.random.default_rng(0), places=PLACES[:5], angles=(-20.0, 0.0, 20.0))
    angles = (-15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0)
    far = see(TRUTH, np.random.default_rng(seed), places=[FAR_PLACE], angles=angles, board=SMALL)
    return near, [replace(view, placement=FAR) for view in far]


def tilt_error_deg(poses: np.ndarray, seen: list[BoardView]) -> np.ndarray:
    """Angle of each pose's normal from the small board's true one [degrees]."""
    axis = np.array(TRUTH.axis.direction), np.array(TRUTH.axis.point)
    true = [head_turned(*axis, view.angle_deg) @ board_at(FAR_PLACE, SMALL) for view in seen]
    cosine = [pose[:3, 2] @ other[:3, 2] for pose, other in zip(poses, true, strict=True)]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("seed", [1, 6])
def test_a_mirrored_view_is_put_right_by_the_others(seed: int):
    """Alone a view's pose leans to the wrong side; adjusted with all, the board stands rightly."""
    near, far = views(seed)
    alone = tilt_error_deg(np.stack([board_pose(view.corners, TRUTH.lens) for view in far]), far)
    assert (alone > 1.5 * TILT_DEG).sum() == 1, alone
    _, report = calibrate_views([*near, *far], BOARD, CAMERA, lens=TRUTH.lens)
    together = tilt_error_deg(report.adjustment.poses[len(near) :], far)
    print(f"alone {alone.round(1)} degrees, together {together.round(2)}")
    assert (together < 0.5).all()


def test_views_that_contradict_each_other_are_refused():
    """Where mirrored views leave no turn that fits the motor, the message names the place."""
    near, far = views(4)
    everything = [*near, *far]
    poses = np.stack([board_pose(view.corners, TRUTH.lens) for view in everything])
    assert (tilt_error_deg(poses[len(near) :], far) > 1.5 * TILT_DEG).sum() == 2
    with pytest.raises(InputError, match=f"at place {FAR + 1} of the board.*too small there"):
        calibrate_turning_axis(everything, poses)


@pytest.mark.parametrize("seed", [0, 1])
def test_small_boards_that_face_the_camera_do_not_spoil_the_lens(seed: int):
    """They show next to no perspective, from which OpenCV takes its first guess of the lens."""
    rng = np.random.default_rng(seed)
    near = see(TRUTH, rng, places=PLACES[:5], angles=(-20.0, -10.0, 0.0, 10.0, 20.0))
    x = float((TRUTH.plane_distance - TRUTH.plane_normal[2] * 4) / TRUTH.plane_normal[0])
    place = Place((x, 0.0, 4.0), (4.0, 3.0, 0.0))
    angles = (-9.0, -4.5, 0.0, 4.5, 9.0)
    far = see(TRUTH, rng, places=[place], angles=angles, noise_px=0.2, board=SMALL)
    found = calibrate_lens([view.corners for view in [*near, *far]], TRUTH.lens.size)
    assert found.rms_px < 0.2
    assert found.lens.fx == pytest.approx(TRUTH.lens.fx, abs=1.0)
    assert found.lens.cx == pytest.approx(TRUTH.lens.cx, abs=1.0)
