"""A whole twin in one piece: room, camera, and a controller's firmware behind a pseudo terminal."""

from __future__ import annotations

from depthwarp.scanner.axes import GrblAxis
from depthwarp.scanner.calibration import Residuals, ScannerCalibration
from depthwarp.scanner.frames import SourceInfo
from depthwarp.scanner.geometry import Vector3, reference_geometry
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.twin.camera import TwinCamera
from depthwarp.scanner.twin.firmware import Firmware
from depthwarp.scanner.twin.renderer import TwinRenderer
from depthwarp.scanner.twin.scene import Scene
from depthwarp.scanner.uncertainty import GeometryCovariance

__all__ = ["TWIN_POSITION", "TwinScanner", "twin_calibration"]

TWIN_POSITION: Vector3 = (1.8, 5.15, 1.25)
"""Where the twin's head stands in the furnished room [m]."""

TIME_SCALE = 400.0
"""Seconds of the twin's motor in one second: its moves take milliseconds."""


class TwinScanner:
    """The reference scanner in the furnished room.

    Camera and axis are used through the same protocols, and the axis through the same serial
    driver, as hardware. A context manager: it ends the firmware.

    Args:
        scale: Size of the sensor relative to the full 1942 x 2590 pixels.
        seed: Seed of the noise.

    Attributes:
        camera: The frame source.
        axis: The motor axis, to be connected.
        calibration: The twin's own geometry, exact.
    """

    def __init__(self, scale: float = 0.25, seed: int = 0) -> None:
        geometry = reference_geometry(scale)
        renderer = TwinRenderer(Scene(furnished_room()), geometry, TWIN_POSITION, seed=seed)
        self.firmware = Firmware("grbl", time_scale=TIME_SCALE)
        self.camera = TwinCamera(renderer, self.firmware)
        self.axis = GrblAxis(self.firmware.path)
        with self.camera as camera:
            self.calibration = twin_calibration(renderer, camera.open())

    def __enter__(self) -> TwinScanner:
        """Return itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the firmware."""
        self.firmware.close()


def twin_calibration(renderer: TwinRenderer, camera: SourceInfo) -> ScannerCalibration:
    """The calibration of a twin: its true geometry, known exactly, with no residuals."""
    return ScannerCalibration(
        geometry=renderer.geometry,
        covariance=GeometryCovariance.from_sigmas({}),
        camera_name=camera.name,
        camera_serial=camera.serial,
        date="1970-01-01T00:00:00+00:00",
        board="none",
        residuals=Residuals(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )
