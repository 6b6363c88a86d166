"""The turning axis from a board that stands still while the head turns: a first guess.

From the camera the board turns the other way round: between motor angles a and b its pose moves
by a rotation of a - b about the axis.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.views import BoardView, place_name, rotation
from depthwarp.scanner.geometry import TurningAxis

__all__ = ["calibrate_turning_axis", "head_turned"]

Float64Array = npt.NDArray[np.float64]

MIN_TURN_DEG = 5.0
"""Pairs of views that are nearer than this say little about the axis."""

MAX_ANGLE_ERROR_DEG = 1.0
"""A board that turned this much more or less than the motor means lost steps or a wrong scale.

It is the median of a placement's pairs of views that counts: the tilt of a far board that nearly
faces the camera is seen to a degree only.
"""


def head_turned(direction: Float64Array, point: Float64Array, degrees: float) -> Float64Array:
    """How the world moves in the optical frame when the head turns, shape (4, 4).

    Args:
        direction: Unit vector of the axis upwards, optical frame.
        point: A point of the axis [m].
        degrees: Turn of the head, counter-clockwise.
    """
    turn = rotation(-np.radians(degrees) * direction)
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = point - turn @ point
    return matrix


def calibrate_turning_axis(views: Sequence[BoardView], poses: Float64Array) -> TurningAxis:
    """The axis about which boards that stood still turn in the camera.

    Args:
        views: Views with their motor angles and placements.
        poses: `optical_from_board` of each view [m], shape (V, 4, 4).

    Returns:
        The axis; its point is the one nearest to the camera's centre.

    Raises:
        InputError: No placement was seen from two motor angles, boards that turned by another
            angle than the motor, or an axis that points down: the motor counts the other way.
    """
    directions, left, right = [], [], []
    turns: dict[int, list[tuple[float, float]]] = {}  # of each placement: by the motor, as seen
    for (first, first_pose), (second, second_pose) in itertools.combinations(
        zip(views, poses, strict=True), 2
    ):
        turned = _wrapped(second.angle_deg - first.angle_deg)
        if first.placement != second.placement or abs(turned) < MIN_TURN_DEG:
            continue
        motion = second_pose @ np.linalg.inv(first_pose)
        vector = np.ravel(cv2.Rodrigues(motion[:3, :3])[0])
        seen = float(np.degrees(np.linalg.norm(vector)))
        turns.setdefault(first.placement, []).append((abs(turned), seen))
        directions.append(-vector * np.sign(turned))
        left.append(np.eye(3) - motion[:3, :3])
        right.append(motion[:3, 3])
    if not directions:
        raise InputError(
            "no board was seen from two motor angles while it stood still: leave it standing, "
            f"turn the head by at least {MIN_TURN_DEG:.0f} degrees and take further views; 10 "
            "views over 40 degrees or more are good"
        )
    for placement, pairs in turns.items():
        _check_turns(placement, np.array(pairs))
    direction = np.sum(directions, axis=0)
    direction /= np.linalg.norm(direction)
    if direction[1] > 0:
        raise InputError(
            "the turning axis comes out upside down: the motor's angles must grow "
            "counter-clockwise seen from above; reverse the motor's direction, or turn the "
            "frames upright"
        )
    # Along the axis the equations say nothing: leave that part out and take the nearest point.
    across = np.eye(3) - np.outer(direction, direction)
    system = np.concatenate([part @ across for part in left])
    point, *_ = np.linalg.lstsq(system, np.concatenate(right), rcond=1e-6)
    point = across @ point
    return TurningAxis(
        direction=(float(direction[0]), float(direction[1]), float(direction[2])),
        point=(float(point[0]), float(point[1]), float(point[2])),
    )


def _wrapped(degrees: float) -> float:
    return (degrees + 180.0) % 360.0 - 180.0


def _check_turns(placement: int, pairs: Float64Array) -> None:
    """Compare turns by the motor with those seen [degrees], shape (N, 2)."""
    error = pairs[:, 1] - pairs[:, 0]
    if abs(np.median(error)) > MAX_ANGLE_ERROR_DEG:
        turned, seen = pairs[np.argsort(error)[len(error) // 2]]
        raise InputError(
            f"at {place_name(placement)} the motor turned by {turned:.2f} degrees, but the board "
            f"by {seen:.2f} degrees in the camera: the motor lost steps or its steps per degree "
            "are wrong, or the board was moved, or is too small there for its tilt to be seen; "
            "find out which, and take that place again"
        )
