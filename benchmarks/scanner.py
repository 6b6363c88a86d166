"""How well the scanner measures: the twin's clouds against the analytic truth.

Run `python -m benchmarks.scanner`; README.md says the method.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console

from benchmarks.measure import machine
from benchmarks.scanner_report import Figures, append_json_lines, figure_table, misses
from depthwarp.cli.report import quiet_warp
from depthwarp.cloud import PointCloud
from depthwarp.scanner.axes import SimulatedAxis
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.geometry import Vector3, reference_geometry
from depthwarp.scanner.lens import undistort
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.processing import process_recording
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.scan import run_scan
from depthwarp.scanner.twin import (
    Laser,
    Scene,
    Sensor,
    TwinCamera,
    TwinRenderer,
    wall_scene,
)
from depthwarp.scanner.twin.session import TWIN_POSITION, twin_calibration
from depthwarp.scanner.uncertainty import range_gradient

Float64Array = npt.NDArray[np.float64]

SENSOR = Sensor(read_noise=2.5, full_well=math.inf)
"""A Bayer sensor of 8 bits with noise of 2.5 grey levels, whatever the level."""

SPECKLE = 0.2
WALL_RANGES = (0.5, 1.0, 2.0, 5.0, 10.0)  # m
NORMAL_AT_1_M_US = 500.0  # the line well below full scale, the light falls with the square
LONGEST_US = 20_000.0  # the room's light of 500 lx fills the sensor at 25 ms
ROOM_US = 10_000.0
BRACKET_US = (1000.0, 4000.0, 16_000.0)
SATURATED_LEVEL = 8.0  # times the laser's light: as eight times the exposure in a darker room
NEAREST_M = 0.5  # the figures hold from here
FALSE_PX, FALSE_SIGMAS = 1.0, 5.0
RAYS_A_ROW = 8  # of the fan, for the line that points are compared with


@dataclass(frozen=True)
class Case:
    """A scan of the twin.

    Attributes:
        name: What is scanned.
        scene: What stands around the scanner.
        exposures_us: One exposure, or a bracket.
        stops: Stops of the turn; a single one looks along the X axis.
        position: Where the head stands [m].
        laser: Its light.
        sensor: Its noise and format.
    """

    name: str
    scene: Scene
    exposures_us: tuple[float, ...]
    stops: int = 1
    position: Vector3 = (0.0, 0.0, 0.0)
    laser: Laser = Laser()
    sensor: Sensor = SENSOR

    def with_speckle(self) -> Case:
        """The same scan with a laser that speckles."""
        return replace(self, laser=replace(self.laser, speckle=SPECKLE))


@dataclass(frozen=True, eq=False)
class Scan:
    """What a scan of the twin gave.

    Attributes:
        renderer: What rendered it, and knows the truth.
        true_angles: Where the head truly pointed at each stop [degrees].
        cloud: The cloud of `process_recording`.
    """

    renderer: TwinRenderer
    true_angles: tuple[float, ...]
    cloud: PointCloud


@dataclass(frozen=True, eq=False)
class _Stop:
    """The points of one stop beside the truth; errors only where a row has one true crossing."""

    column_error: Float64Array
    range_error: Float64Array
    sigma: Float64Array
    points: int
    false_points: int
    visible: int
    found: int


def wall_case(range_m: float, laser: Laser | None = None) -> Case:
    """A wall whose line is `range_m` from the camera in the frame's middle, at normal exposure."""
    # r^2 = z^2 + (0.5 - 0.85 z)^2, the reference geometry's laser plane at depth z.
    a, b, c = 1.0 + 0.85**2, -2.0 * 0.85 * 0.5, 0.25 - range_m**2
    depth = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
    exposure = min(NORMAL_AT_1_M_US * range_m**2, LONGEST_US)
    return Case(f"wall at {range_m:g} m", wall_scene(depth), (exposure,), laser=laser or Laser())


def saturated(case: Case) -> Case:
    """The same case with several times the light of the laser."""
    laser = replace(case.laser, level=SATURATED_LEVEL * case.laser.level)
    return replace(case, name=f"{case.name}, saturated", laser=laser)


def room_case(stops: int) -> Case:
    """One turn in the furnished room, with one exposure."""
    return Case("room", Scene(furnished_room()), (ROOM_US,), stops, TWIN_POSITION)


def room_cases(stops: int) -> list[Case]:
    """The room as it is, without what a mosaic leaves out, and with a bracket of exposures."""
    room = room_case(stops)
    every_color = replace(SENSOR, pixel_format=PixelFormat.BGR)
    return [
        room,
        replace(room, name="room, no mosaic", sensor=every_color),
        replace(room, name="room, bracket", exposures_us=BRACKET_US),
    ]


def scan(case: Case, scale: float) -> Scan:
    """Run a case through the whole chain: camera, motor, recording, colour, line, cloud."""
    renderer = TwinRenderer(
        case.scene, reference_geometry(scale), case.position, laser=case.laser, sensor=case.sensor
    )
    axis = SimulatedAxis()
    camera = TwinCamera(renderer, axis)
    plan = ScanPlan.turn(case.stops, exposures_us=case.exposures_us, settle_s=0.0)
    angles: list[float] = []
    with tempfile.TemporaryDirectory() as folder, camera, axis:
        info = camera.open()
        recording = Recording.create(
            Path(folder) / "scan", plan, info, {"position": list(case.position)}
        )
        run_scan(recording, camera, axis, progress=lambda _: angles.append(axis.true_angle))
        cloud = process_recording(recording, twin_calibration(renderer, info)).cloud
    return Scan(renderer, tuple(angles), cloud)


def measure(case: Case, scale: float) -> Figures:
    """Scan a case and compare its cloud with the truth."""
    result = scan(case, scale)
    frame = result.cloud.attributes["frame"]
    stops = [
        _compare(result, angle, np.flatnonzero(frame == number))
        for number, angle in enumerate(result.true_angles)
    ]
    column_error, range_error, sigma = (
        np.concatenate([getattr(stop, name) for stop in stops])
        for name in ("column_error", "range_error", "sigma")
    )
    pull = range_error / sigma
    return Figures(
        case=case.name,
        scale=scale,
        speckle=case.laser.speckle,
        visible=sum(stop.visible for stop in stops),
        found=sum(stop.found for stop in stops),
        points=sum(stop.points for stop in stops),
        false_points=sum(stop.false_points for stop in stops),
        rms_px=float(np.sqrt(np.mean(column_error**2))),
        bias_px=float(np.mean(column_error)),
        median_range_error_m=float(np.median(np.abs(range_error))),
        median_sigma_m=float(np.median(sigma)),
        median_pull=float(np.median(np.abs(pull))),
        pull_deviation=float(np.std(pull)),
    )


def _compare(result: Scan, angle: float, chosen: npt.NDArray[np.intp]) -> _Stop:
    """The points `chosen` of a cloud, all of one stop, beside the truth at its true angle."""
    truth = result.renderer.truth(angle)
    attributes = result.cloud.attributes
    row = np.rint(attributes["row"][chosen]).astype(np.intp)
    pixel = result.renderer.project(result.cloud.points_world[chosen], angle)
    sigma = attributes["sigma"][chosen].astype(np.float64)
    sigma_px = sigma / _range_by_column(result.renderer, pixel)
    far = _distance_to_line(pixel, _line_pixels(result.renderer, angle))
    is_false = far > np.maximum(FALSE_PX, FALSE_SIGMAS * sigma_px)
    single = ~is_false & truth.visible[row] & (truth.crossings[row] == 1)
    asked = truth.visible & (truth.range >= NEAREST_M)
    has_point = np.zeros(len(asked), bool)
    has_point[row[~is_false]] = True
    return _Stop(
        column_error=pixel[single, 0] - truth.column[row[single]],
        range_error=attributes["range"][chosen][single] - truth.range[row[single]],
        sigma=sigma[single],
        points=len(chosen),
        false_points=int(is_false.sum()),
        visible=int(asked.sum()),
        found=int((asked & has_point).sum()),
    )


def _range_by_column(renderer: TwinRenderer, pixel: Float64Array) -> Float64Array:
    """How much a range moves with its pixel's column [m/px], shape (N,)."""
    geometry = renderer.geometry
    return np.abs(range_gradient(geometry, undistort(geometry.lens, pixel))[0])


def _line_pixels(renderer: TwinRenderer, angle: float) -> Float64Array:
    """Pixels (column, row) of every visible place of the line, densely, in ascending rows."""
    placement, laser, scene = renderer.placement, renderer.placement.laser, renderer.scene
    rotation, camera = placement.world_from_optical(angle)
    half = math.radians(renderer.laser.fan / 2)
    turn = np.linspace(-half, half, RAYS_A_ROW * renderer.geometry.lens.size[1])[:, None]
    rays = (np.cos(turn) * laser.forward + np.sin(turn) * laser.up) @ rotation.T
    source = camera + rotation @ laser.origin
    distance, _ = scene.cast(source, rays)
    hit = np.isfinite(distance)
    points = source + distance[hit, None] * rays[hit]
    reach = np.linalg.norm(points - camera, axis=1)
    seen, _ = scene.cast(camera, (points - camera) / reach[:, None])
    pixels = renderer.project(points[np.abs(seen - reach) <= 1e-6 * reach], angle)
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    return pixels[np.argsort(pixels[:, 1], kind="stable")]


def _distance_to_line(pixel: Float64Array, line: Float64Array) -> Float64Array:
    """Distance of pixels to the nearest one of a line in ascending rows; inf beyond two rows."""
    first, last = (np.searchsorted(line[:, 1], pixel[:, 1] + side) for side in (-2.0, 2.0))
    distance = np.full(len(pixel), np.inf)
    for number, (begin, end) in enumerate(zip(first, last, strict=True)):
        if begin < end:
            distance[number] = np.linalg.norm(line[begin:end] - pixel[number], axis=1).min()
    return distance


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a figure is missed."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.json is not None and not options.json.parent.is_dir():
        parser.error(f"--json {options.json}: there is no folder {options.json.parent}")
    quiet_warp()
    console = Console(highlight=False)
    here = machine()
    console.print(f"{here['processor']}, Warp {here['warp']}, sensor at scale {options.scale:g}")
    walls = [wall_case(range_m) for range_m in WALL_RANGES]
    pairs = []
    for case in (*walls, *(saturated(wall) for wall in walls), *room_cases(options.stops)):
        pairs.append((measure(case, options.scale), measure(case.with_speckle(), options.scale)))
        console.print(f"{case.name}: done")
    console.print(figure_table(pairs))
    if options.json is not None:
        append_json_lines(options.json, here, [figures for pair in pairs for figures in pair])
    missed = [line for without_speckle, _ in pairs for line in misses(without_speckle)]
    for line in missed:
        console.print(f"missed: {line}")
    return 1 if missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scanner", description=__doc__)
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="size of the sensor; 1 is 1942 x 2590 px (default: %(default)s)",
    )
    parser.add_argument(
        "--stops", type=int, default=12, help="stops of a turn in the room (default: %(default)s)"
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="append the results to FILE, one JSON line a scan"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
