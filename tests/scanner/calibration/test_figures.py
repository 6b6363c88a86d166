"""The calibration's figures on synthetic boards, and that its sigmas and refusals are honest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    BoardView,
    CalibrationReport,
    Grade,
    ScannerCalibration,
    calibrate_laser_plane,
    calibrate_lens,
    calibrate_turning_axis,
    calibrate_views,
)
from depthwarp.scanner.calibration.laser_plane import fit_plane
from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.views import board_pose
from depthwarp.scanner.frames import PixelFormat, SourceInfo
from depthwarp.scanner.geometry import ScannerGeometry, reference_geometry
from depthwarp.scanner.lens import project
from depthwarp.scanner.triangulation import triangulate
from depthwarp.scanner.uncertainty import PARAMETERS, tangents
from tests.scanner.calibration.synthetic import BOARD, PLACES, see, tilted

TRUTH = tilted(reference_geometry())
CAMERA = SourceInfo("synthetic", "S-1", TRUTH.lens.size, PixelFormat.MONO, True)


def angle_between(first: object, second: object) -> float:
    """Angle between two unit vectors [rad], exact when it is small."""
    a, b = np.asarray(first), np.asarray(second)
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def axis_offset(truth: ScannerGeometry, found: ScannerGeometry) -> float:
    """Distance of the found axis from the true one beside the camera [m]."""
    direction = np.array(truth.axis.direction)
    between = np.array(found.axis.point) - truth.axis.point
    return float(np.linalg.norm(between - (between @ direction) * direction))


@pytest.fixture(scope="module")
def views() -> list[BoardView]:
    return see(TRUTH, np.random.default_rng(0))


@pytest.fixture(scope="module")
def calibrated(views: list[BoardView]) -> tuple[ScannerCalibration, CalibrationReport]:
    return calibrate_views(views, BOARD, CAMERA)


def test_plane_and_axis_are_within_their_figures(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """With 0.1 px noise: plane within 0.1 mrad and 0.1 mm, axis within 0.05 mrad and 0.1 mm."""
    calibration, report = calibrated
    found = calibration.geometry
    plane_mrad = 1e3 * angle_between(TRUTH.plane_normal, found.plane_normal)
    plane_mm = 1e3 * abs(TRUTH.plane_distance - found.plane_distance)
    axis_mrad = 1e3 * angle_between(TRUTH.axis.direction, found.axis.direction)
    axis_mm = 1e3 * axis_offset(TRUTH, found)
    print(
        f"{calibration.residuals.views} views: plane {plane_mrad:.3f} mrad {plane_mm:.3f} mm, "
        f"axis {axis_mrad:.3f} mrad {axis_mm:.3f} mm, "
        f"corners {report.adjustment.corner_rms_px:.4f} px\n{report.text}"
    )
    assert plane_mrad <= 0.1
    assert plane_mm <= 0.1
    assert axis_mrad <= 0.05
    assert axis_mm <= 0.1
    assert report.adjustment.corner_rms_px == pytest.approx(0.1, rel=0.05)
    assert report.adjustment.laser_rms_px == pytest.approx(0.1, rel=0.1)


def test_errors_are_as_large_as_the_sigmas_say(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """The error of every parameter is within four sigma, and all together within chi-square."""
    calibration, _ = calibrated
    found, truth = calibration.geometry, TRUTH
    plane, axis = tangents(truth.plane_normal), tangents(truth.axis.direction)
    error = np.array(
        [
            *(
                np.array([found.lens.fx, found.lens.fy, found.lens.cx, found.lens.cy])
                - [truth.lens.fx, truth.lens.fy, truth.lens.cx, truth.lens.cy]
            ),
            *(np.array(found.lens.distortion) - truth.lens.distortion),
            *(plane @ np.array(found.plane_normal)),
            found.plane_distance - truth.plane_distance,
            *(axis @ np.array(found.axis.direction)),
            *(axis @ (np.array(found.axis.point) - truth.axis.point)),
        ]
    )
    known = np.array([name != "k3" for name in PARAMETERS])  # not shown by the views: held at 0
    assert found.lens.distortion[4] == 0.0
    covariance = calibration.covariance.matrix[np.ix_(known, known)]
    sigmas = np.sqrt(np.diag(covariance))
    print("error in sigmas:", (error[known] / sigmas).round(2))
    assert (np.abs(error[known]) < 4 * sigmas).all()
    scaled = covariance / np.outer(sigmas, sigmas)
    chi_square = (error[known] / sigmas) @ np.linalg.solve(scaled, error[known] / sigmas)
    assert 2.0 < chi_square < 45.0  # 15 degrees of freedom: outside lies less than 1 in 5000


def test_a_still_point_moves_in_the_camera_as_the_geometry_says():
    """Turning the head is the same motion here as in `p_world = Rz(a) p_head`."""
    world = np.array([2.0, 1.0, 0.5])
    optical_from_head = np.linalg.inv(TRUTH.head_from_optical)

    def seen(degrees: float) -> np.ndarray:
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        head = np.array([cos * world[0] + sin * world[1], cos * world[1] - sin * world[0], 0.5])
        return optical_from_head @ [*head, 1.0]

    axis = np.array(TRUTH.axis.direction), np.array(TRUTH.axis.point)
    np.testing.assert_allclose(head_turned(*axis, 33.0) @ seen(0.0), seen(33.0), atol=1e-12)


def test_without_noise_the_scanner_comes_out_exactly():
    """Exact views lead to the exact geometry: the model of the adjustment is the true one."""
    exact = see(TRUTH, np.random.default_rng(0), angles=(-20.0, 0.0, 20.0), noise_px=0.0)
    calibration, _ = calibrate_views(exact, BOARD, CAMERA, lens=TRUTH.lens)
    found = calibration.geometry
    assert found.lens == TRUTH.lens
    assert angle_between(TRUTH.plane_normal, found.plane_normal) < 1e-7
    assert found.plane_distance == pytest.approx(TRUTH.plane_distance, abs=1e-7)
    assert angle_between(TRUTH.axis.direction, found.axis.direction) < 1e-7
    assert axis_offset(TRUTH, found) < 1e-7
    assert (np.diag(calibration.covariance.matrix)[:9] == 0).all()


def test_points_at_all_ranges_are_as_far_off_as_their_sigma_says(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """Exact peaks through the calibrated scanner: correlated errors are carried to 15 m rightly."""
    calibration, _ = calibrated
    depth = np.array([1.0, 2.0, 5.0, 10.0, 14.0])
    normal = np.array(TRUTH.plane_normal)
    x = (TRUTH.plane_distance - normal[2] * depth) / normal[0]
    points = np.column_stack([x, np.zeros(5), depth])
    pixels = project(TRUTH.lens, points)
    geometry = replace(calibration.geometry, max_range=100.0)
    found = triangulate(geometry, pixels[:, 1], pixels[:, 0], 0.0, 0.0, calibration.covariance)
    error = found.range_m - np.linalg.norm(points, axis=1)
    print("range error [mm]", (1e3 * error).round(2), "sigma", (1e3 * found.sigma_m).round(2))
    assert (np.abs(error) < 4 * found.sigma_m).all()
    assert found.sigma_m[-1] < 0.02


def test_good_numbers_without_far_targets_are_usable_and_no_more(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """What the residuals cannot show, the farthest board tells: the verdict asks for more."""
    _, report = calibrated
    assert report.verdict.grade is Grade.USABLE
    (far,) = (check for check in report.verdict.checks if check.grade is not Grade.GOOD)
    assert "farthest board" in far.name
    assert far.value == pytest.approx(2.67, abs=0.1)
    assert "best up to 15 m: an error of 0.1 mrad" in report.text


def test_reflections_do_not_move_the_laser_plane(views: list[BoardView]):
    """A tenth of the peaks thrown elsewhere are found out; the plane stays."""
    lens = TRUTH.lens
    poses = np.stack([board_pose(view.corners, lens) for view in views])
    clean = calibrate_laser_plane(views, lens, poses)
    rng = np.random.default_rng(5)
    spoiled = []
    for view in views:
        pixels = view.laser_pixels.copy()
        wrong = rng.random(len(pixels)) < 0.1
        pixels[wrong, 0] += rng.choice((-1, 1), wrong.sum()) * rng.uniform(10, 60, wrong.sum())
        spoiled.append(replace(view, laser_pixels=pixels))
    robust = calibrate_laser_plane(spoiled, lens, poses)
    assert 0.87 < robust.inliers.mean() < 0.92
    assert angle_between(clean.normal, robust.normal) < 2e-5
    again = calibrate_laser_plane(spoiled, lens, poses)
    assert again.distance == robust.distance


def test_peaks_on_one_line_in_space_are_refused():
    """Boards that all stand in one plane leave the laser plane open."""
    along = np.linspace(-0.3, 0.3, 200)
    line = np.column_stack([0.01 * along, along, np.full(200, 1.5)])
    noise = np.random.default_rng(0).normal(0, 1e-4, line.shape)
    with pytest.raises(InputError, match="one line in space"):
        fit_plane(line + noise, 1295.0)
    with pytest.raises(InputError, match="12 laser peaks on the boards, at least 30"):
        fit_plane(line[:12], 1295.0)
    with pytest.raises(InputError, match="of the laser peaks lie in one plane"):
        fit_plane(np.random.default_rng(1).uniform(0.5, 1.5, (300, 3)), 1295.0)


def test_wrong_motor_scale_direction_or_missing_turns_are_refused(views: list[BoardView]):
    """Lost steps, a reversed motor and a head that never turned are told apart."""
    poses = np.stack([board_pose(view.corners, TRUTH.lens) for view in views])

    def with_angles(factor: float) -> list[BoardView]:
        return [replace(view, angle_deg=factor * view.angle_deg) for view in views]

    with pytest.raises(InputError, match="lost steps or its steps per degree are wrong"):
        calibrate_turning_axis(with_angles(1.2), poses)
    with pytest.raises(InputError, match="upside down.*counter-clockwise"):
        calibrate_turning_axis(with_angles(-1.0), poses)
    with pytest.raises(InputError, match="no board was seen from two motor angles"):
        calibrate_turning_axis(with_angles(0.0), poses)
    whole_turns = [replace(view, angle_deg=view.angle_deg + 720.0) for view in views]
    found = calibrate_turning_axis(whole_turns, poses)
    assert angle_between(found.direction, TRUTH.axis.direction) < 1e-3


def with_lost_steps(views: list[BoardView], lost_deg: float, first: float) -> list[BoardView]:
    """Views of which the third place's are reported too far from a motor angle on."""
    return [
        replace(view, angle_deg=view.angle_deg + lost_deg * (view.angle_deg >= first))
        if view.placement == 2
        else view
        for view in views
    ]


def test_steps_lost_in_the_middle_of_a_place_are_refused(views: list[BoardView]):
    """Most pairs of its views then turn by another angle than the motor."""
    poses = np.stack([board_pose(view.corners, TRUTH.lens) for view in views])
    with pytest.raises(InputError, match="at place 3 of the board the motor turned by"):
        calibrate_turning_axis(with_lost_steps(views, 1.8, 5.0), poses)


@pytest.mark.parametrize(("lost_deg", "first"), [(1.8, 25.0), (0.45, 25.0), (0.45, 5.0)])
def test_fewer_lost_steps_make_the_verdict_bad(
    views: list[BoardView], lost_deg: float, first: float
):
    """At the last view alone, or few: the view that fits worst is judged by itself and named."""
    half = [view for view in views if view.angle_deg % 10 == 5]  # for speed
    _, report = calibrate_views(with_lost_steps(half, lost_deg, first), BOARD, CAMERA)
    everything, worst = report.verdict.checks[0], report.verdict.checks[-1]
    print(f"{lost_deg} degrees lost: all {everything.value:.2f} px, worst {worst.value:.1f} px")
    assert report.verdict.grade is worst.grade is Grade.BAD
    assert "worst view (place 3 of the board, head at" in worst.name
    assert "the motor lost steps" in worst.text


def test_a_lens_from_poor_views_is_refused_in_words(views: list[BoardView]):
    """Too few views, parallel boards and another camera's frames are refused, each by name."""
    corners = [view.corners for view in views]
    with pytest.raises(InputError, match="3 views of the board are too few"):
        calibrate_lens(corners[:3], CAMERA.size)
    with pytest.raises(InputError, match="outside the frame of 1000 x 1000"):
        calibrate_lens(corners, (1000, 1000))
    flat = [
        replace(place, middle=(x, y, 1.2), tilt=(3.0, 0.0, 0.0))
        for place, x, y in zip(PLACES, (0.0, 0.1, -0.1, 0.2, -0.2, 0, 0), range(-3, 4), strict=True)
    ]
    flat = [replace(p, middle=(p.middle[0], 0.2 * p.middle[1], 1.2)) for p in flat]
    parallel = see(TRUTH, np.random.default_rng(0), places=flat, angles=(0.0,))
    with pytest.raises(InputError, match="parallel within .* degrees.*tilt the board"):
        calibrate_lens([view.corners for view in parallel], CAMERA.size)
