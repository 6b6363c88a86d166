"""The calibration of one scanner as a file: what it says, whose it is, and that it is unchanged."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path
from depthwarp.scanner.frames import SourceInfo
from depthwarp.scanner.geometry import Lens, ScannerGeometry, TurningAxis
from depthwarp.scanner.json_files import JsonKind
from depthwarp.scanner.uncertainty import GeometryCovariance

__all__ = ["Residuals", "ScannerCalibration", "load_calibration"]

FILE_KIND = JsonKind(
    "calibration", ("schema", "depthwarp scanner calibration"), 1, "calibrate again"
)


@dataclass(frozen=True)
class Residuals:
    """What a calibration was made from and how well it fits.

    Attributes:
        views: Views of the board.
        placements: Places where the board stood.
        laser_peaks: Peaks of the laser line on the board that lie in the plane.
        corner_rms_px: Root mean square residual of the corners, one coordinate [px].
        laser_rms_px: Of the laser peaks, across the line [px].
        laser_rms_m: Distance of the laser points from the plane, root mean square [m].
        laser_nearest_m: Distance of the nearest laser point from the camera [m].
        laser_farthest_m: Of the farthest [m].
        rim_covered: Share of the frame's rim where corners were seen.
        tilt_spread_deg: Largest angle between two views of the board [degrees].
        turn_deg: Largest turn of the head while a board stood still [degrees].
    """

    views: int
    placements: int
    laser_peaks: int
    corner_rms_px: float
    laser_rms_px: float
    laser_rms_m: float
    laser_nearest_m: float
    laser_farthest_m: float
    rim_covered: float
    tilt_spread_deg: float
    turn_deg: float


@dataclass(frozen=True, eq=False)
class ScannerCalibration:
    """A scanner's geometry, how well it is known, and the camera that it belongs to.

    Attributes:
        geometry: Lens, laser plane and turning axis.
        covariance: Their uncertainty.
        camera_name: Model of the camera, for people.
        camera_serial: Serial number of the camera.
        date: When it was made, ISO 8601 with time zone.
        board: The board that was used, as `parse_board` reads it.
        residuals: How well it fits.
    """

    geometry: ScannerGeometry
    covariance: GeometryCovariance
    camera_name: str
    camera_serial: str
    date: str
    board: str
    residuals: Residuals

    @property
    def camera_size(self) -> tuple[int, int]:
        """(width, height) of the camera's upright frames [px]."""
        return self.geometry.lens.size

    @property
    def content_hash(self) -> str:
        """SHA-256 of everything it says, in hexadecimal: what a recording keeps of it."""
        text = json.dumps(_content(self), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def require_camera(self, info: SourceInfo) -> None:
        """Refuse to be used with another camera than its own.

        Raises:
            InputError: Another serial number or another frame size.
        """
        if info.serial != self.camera_serial:
            raise InputError(
                f"the calibration of {self.date} belongs to camera {self.camera_name} with serial "
                f"number {self.camera_serial}, this is {info.name} with {info.serial}: use that "
                "camera's calibration, or calibrate this one"
            )
        if info.size != self.camera_size:
            raise InputError(
                f"the calibration is for frames of {self.camera_size[0]} x {self.camera_size[1]} "
                f"px, the camera gives {info.size[0]} x {info.size[1]} px: set the camera's full "
                "frame as it was calibrated, upright, or calibrate it at this size"
            )

    def require_hash(self, content_hash: str) -> None:
        """Refuse to stand in for another calibration, as when a recording is replayed.

        Raises:
            InputError: This is another one.
        """
        if content_hash != self.content_hash:
            raise InputError(
                f"the calibration with hash {content_hash[:12]} is asked for, this one of "
                f"{self.date} has {self.content_hash[:12]}: use the file that the scan was made "
                "with"
            )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as JSON; the file appears whole or not at all.

        Raises:
            InputError: A path that cannot be written.
        """
        content = {**_content(self), "sha256": self.content_hash}
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")


def load_calibration(path: str | os.PathLike[str]) -> ScannerCalibration:
    """Read a calibration.

    Raises:
        InputError: There is no such file.
        FileFormatError: Not a calibration, one of a newer version, or one that was changed.
    """

    def parse(content: dict[str, Any]) -> ScannerCalibration:
        calibration = _from_content(content)
        if content["sha256"] != calibration.content_hash:
            raise FileFormatError(
                f"{path} was changed after it was written, its hash does not fit its numbers: use "
                "the original file, or calibrate again"
            )
        return calibration

    return FILE_KIND.read(path, parse)


def _content(calibration: ScannerCalibration) -> dict[str, Any]:
    geometry = calibration.geometry
    lens = dataclasses.asdict(geometry.lens)
    return {
        **FILE_KIND.header,
        "date": calibration.date,
        "camera": {"name": calibration.camera_name, "serial": calibration.camera_serial},
        "board": calibration.board,
        "lens": {**lens, "size": list(lens["size"]), "distortion": list(lens["distortion"])},
        "plane": {"normal": list(geometry.plane_normal), "distance": geometry.plane_distance},
        "axis": {"direction": list(geometry.axis.direction), "point": list(geometry.axis.point)},
        "max_range": geometry.max_range,
        "covariance": calibration.covariance.matrix.tolist(),
        "residuals": dataclasses.asdict(calibration.residuals),
    }


def _from_content(content: dict[str, Any]) -> ScannerCalibration:
    """The calibration in a file's content; raises whatever odd content leads to."""
    lens, plane, axis = content["lens"], content["plane"], content["axis"]
    residuals = {
        field.name: content["residuals"][field.name] for field in dataclasses.fields(Residuals)
    }
    numbers = [lens["fx"], lens["fy"], *lens["size"], plane["distance"], content["max_range"]]
    if not all(math.isfinite(number) and number > 0 for number in numbers):
        raise ValueError(f"focal lengths, sizes and distances must be above 0, got {numbers}")
    geometry = ScannerGeometry(
        lens=Lens(
            fx=float(lens["fx"]),
            fy=float(lens["fy"]),
            cx=float(lens["cx"]),
            cy=float(lens["cy"]),
            size=_numbers(lens["size"], 2, int),
            distortion=_numbers(lens["distortion"], 5),
        ),
        plane_normal=_numbers(plane["normal"], 3),
        plane_distance=float(plane["distance"]),
        axis=TurningAxis(_numbers(axis["direction"], 3), _numbers(axis["point"], 3)),
        max_range=float(content["max_range"]),
    )
    return ScannerCalibration(
        geometry=geometry,
        covariance=GeometryCovariance(np.array(content["covariance"], np.float64)),
        camera_name=str(content["camera"]["name"]),
        camera_serial=str(content["camera"]["serial"]),
        date=str(content["date"]),
        board=str(content["board"]),
        residuals=Residuals(**residuals),
    )


def _numbers(values: Any, count: int, kind: type = float) -> Any:
    if len(values) != count:
        raise ValueError(f"{count} numbers expected, got {values}")
    return tuple(kind(value) for value in values)
