"""The twin: a simulated scanner in an analytic room, in place of camera, laser and motor."""

from __future__ import annotations

from depthwarp.scanner.twin.boards import Board, board_pose, charuco, chessboard
from depthwarp.scanner.twin.camera import CameraFault, TwinCamera
from depthwarp.scanner.twin.folder import render_turn_to_folder, turn_shots
from depthwarp.scanner.twin.head import HeadState, StillHead
from depthwarp.scanner.twin.optics import Laser, Sensor
from depthwarp.scanner.twin.renderer import Shot, TwinRenderer
from depthwarp.scanner.twin.scene import Scene, wall_scene
from depthwarp.scanner.twin.truth import LineTruth

__all__ = [
    "Board",
    "CameraFault",
    "HeadState",
    "Laser",
    "LineTruth",
    "Scene",
    "Sensor",
    "Shot",
    "StillHead",
    "TwinCamera",
    "TwinRenderer",
    "board_pose",
    "charuco",
    "chessboard",
    "render_turn_to_folder",
    "turn_shots",
    "wall_scene",
]
