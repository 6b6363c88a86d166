"""Views of a board that OpenCV's lens calibration takes for tilted to the wrong side."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from depthwarp.scanner.calibration.intrinsics import calibrate_lens
from depthwarp.scanner.calibration.views import BoardView, board_pose

__all__ = ["without_mirrored"]

MIRROR_TURN = math.radians(3.0)
"""A view whose two poses differ by more has its tilt mirrored."""

MIRROR_ROUNDS = 3


def without_mirrored(
    views: Sequence[BoardView], size: tuple[int, int]
) -> tuple[list[BoardView], tuple[str, ...]]:
    """Leave out views whose pose OpenCV's lens calibration takes for its mirror image.

    A board that is far away looks nearly the same tilted to either side. The calibration of the
    lens starts each view without its distortion, may take the wrong side and stays there; the pose
    from the calibrated lens tells.

    Returns:
        The other views, and one line for each that was left out.
    """
    kept, skipped = list(views), []
    for _ in range(MIRROR_ROUNDS):
        fit = calibrate_lens([view.corners for view in kept], size)
        turned = [
            pose[:3, :3].T @ board_pose(view.corners, fit.lens)[:3, :3]
            for view, pose in zip(kept, fit.poses, strict=True)
        ]
        is_mirrored = [np.trace(turn) < 1 + 2 * math.cos(MIRROR_TURN) for turn in turned]
        if not any(is_mirrored):
            break
        skipped += [
            f"placement {view.placement} at {view.angle_deg:g} degrees: its tilt is ambiguous"
            for view, is_out in zip(kept, is_mirrored, strict=True)
            if is_out
        ]
        kept = [view for view, is_out in zip(kept, is_mirrored, strict=True) if not is_out]
    return kept, tuple(skipped)
