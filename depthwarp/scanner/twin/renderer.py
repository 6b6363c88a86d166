"""Render what the scanner's camera sees at a turning angle, on any device, with its truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.arrays import empty, share
from depthwarp.checks import check_positive
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.geometry import ScannerGeometry, Vector3
from depthwarp.scanner.lens import project
from depthwarp.scanner.twin.optics import Laser, Sensor
from depthwarp.scanner.twin.placement import Placement
from depthwarp.scanner.twin.rays import TILE, pixel_rays, solids_of_tiles
from depthwarp.scanner.twin.scene import Scene
from depthwarp.scanner.twin.truth import LineTruth, line_truth
from depthwarp_kernels import twin as kernels

__all__ = ["Shot", "TwinRenderer"]

Float64Array = npt.NDArray[np.float64]

SKY = (0.75, 0.85, 1.0)
"""Red, green, blue of open air beside a white surface that faces the lamp."""

MOSAICS = {
    PixelFormat.BAYER_RGGB: (0, 1, 1, 2),
    PixelFormat.BAYER_GRBG: (1, 0, 2, 1),
    PixelFormat.BAYER_GBRG: (1, 2, 0, 1),
    PixelFormat.BAYER_BGGR: (2, 1, 1, 0),
}
"""Colour (0 red, 1 green, 2 blue) of the upper left 2 x 2 pixels, by row."""


@dataclass(frozen=True)
class Shot:
    """One picture to render.

    Attributes:
        angle: Where the head points [degrees], counter-clockwise seen from above.
        laser_on: Whether the laser is lit.
        exposure_us: Exposure time [microseconds].
        gain_db: Gain [dB], on the signal and its shot noise.
        number: Tells repeated shots apart: each has its own noise.
    """

    angle: float
    laser_on: bool = True
    exposure_us: float = 2000.0
    gain_db: float = 0.0
    number: int = 0

    def __post_init__(self) -> None:
        check_positive("exposure_us", self.exposure_us, "microseconds")
        if not (math.isfinite(self.angle) and math.isfinite(self.gain_db)):
            raise InputError(
                f"angle and gain_db must be finite, got {self.angle} and {self.gain_db}"
            )
        if self.number < 0:
            raise InputError(f"number must be at least 0, got {self.number}")


class TwinRenderer:
    """Renders frames of a scanner that stands in a scene.

    The picture is the same, to the bit, for the same settings, seed and shot on one kind of
    device. The surfaces of the last angle are kept: a second shot at it only has to be exposed.

    Args:
        scene: What stands around the scanner.
        geometry: Lens, laser plane and turning axis; the frame's size is the lens's.
        position: Where the origin of the head frame stands, world frame [m].
        laser: The laser's light.
        sensor: Noise, bits and pixel format.
        seed: Seed of noise and speckle.
        device: Name of a Warp device; None is Warp's default one.

    Raises:
        InputError: The laser stands inside a solid, the lens cannot be undistorted, or a value is
            out of its range.

    Example:
        >>> scene = Scene(furnished_room())
        >>> renderer = TwinRenderer(scene, reference_geometry(0.25), (1.79, 3.3, 1.2))
        >>> pixels = renderer.render(Shot(angle=90.0, laser_on=True))
    """

    def __init__(
        self,
        scene: Scene,
        geometry: ScannerGeometry,
        position: Vector3 = (0.0, 0.0, 0.0),
        *,
        laser: Laser | None = None,
        sensor: Sensor | None = None,
        seed: int = 0,
        device: str | None = None,
    ) -> None:
        if seed < 0:
            raise InputError(f"seed must be at least 0, got {seed}")
        self.scene = scene
        self.geometry = geometry
        self.placement = Placement(geometry, position)
        self.laser = Laser() if laser is None else laser
        self.sensor = Sensor() if sensor is None else sensor
        self.seed = seed
        self.device = resolve_device(device)
        self._rays = pixel_rays(geometry.lens)
        self._fan = self._fan_struct()
        self._upload_static()
        self._traced: float | None = None

    def render(self, shot: Shot) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
        """Render one picture.

        Returns:
            Shape (H, W) for a mosaic or (H, W, 3) for BGR; uint8 for 8 bits, else uint16 with the
            number in its low bits.

        Raises:
            InputError: At this angle the camera or the laser stands inside a solid.
        """
        if self._traced != shot.angle:
            self._trace(shot.angle)
        wp.launch(
            kernels.expose,
            dim=self._depth.shape,
            inputs=[
                self._exposure_struct(shot),
                self._fan,
                self._slopes,
                self._solids,
                self._depth,
                self._surface,
                self._ambient,
                self._reflectance,
                self._texels,
            ],
            outputs=[self._pixels],
            device=self.device,
        )
        pixels: npt.NDArray[np.uint16] = self._pixels.numpy()
        if pixels.shape[2] == 1:
            pixels = pixels[:, :, 0]
        if self.sensor.bits == 8:
            return pixels.astype(np.uint8)
        return pixels.copy()  # on a CPU it is the array that the next shot writes to

    def surfaces(self, angle: float) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
        """What each pixel's middle sees at an angle [degrees].

        Returns:
            Depth along the viewing direction [m], 0 for nothing, and surface of the scene, -1 for
            nothing, both of shape (H, W).
        """
        if self._traced != angle:
            self._trace(angle)
        return self._depth.numpy().copy(), self._surface.numpy().copy()

    def truth(self, angle: float) -> LineTruth:
        """Where the laser line truly is in the frame at an angle [degrees], without noise."""
        return line_truth(self.scene, self.placement, self.laser, angle)

    def project(self, points_world: npt.ArrayLike, angle: float) -> Float64Array:
        """Pixels (column, row) of points, NaN for those that the lens cannot see.

        Args:
            points_world: World frame [m], shape (N, 3).
            angle: Where the head points [degrees].
        """
        rotation, camera = self.placement.world_from_optical(angle)
        points_optical = (np.asarray(points_world, np.float64) - camera) @ rotation
        return project(self.geometry.lens, points_optical)

    def _fan_struct(self) -> Any:
        frame = self.placement.laser
        fan: Any = kernels.Fan()
        fan.normal = wp.vec3f(*self.geometry.plane_normal)
        fan.distance = self.geometry.plane_distance
        fan.origin, fan.forward, fan.up = (
            wp.vec3f(*vector) for vector in (frame.origin, frame.forward, frame.up)
        )
        fan.tangent = math.tan(math.radians(self.laser.fan / 2))
        fan.waist = self.laser.waist
        fan.divergence = self.laser.divergence
        return fan

    def _upload_static(self) -> None:
        """What no angle changes: rays, surfaces and prints; and the frame's own arrays."""
        solids, boards, device = self.scene.solids, self.scene.boards, self.device
        width, height = self.geometry.lens.size
        channels = 3 if self.sensor.pixel_format is PixelFormat.BGR else 1
        self._slopes = share(self._rays.slopes, wp.vec2f, device)
        self._ambient = share(solids.ambient.astype(np.float32), wp.vec3f, device)
        self._reflectance = share(solids.reflectance.astype(np.float32), wp.float32, device)
        prints = [board.print.ravel() for board in boards]
        self._texels = share(np.concatenate([*prints, np.zeros(1, np.uint8)]), wp.uint8, device)
        self._depth = empty((height, width), wp.float32, device)
        self._surface = empty((height, width), wp.int32, device)
        self._pixels = empty((height, width, channels), wp.uint16, device)
        layout: Any = kernels.Solid
        table: Any = np.zeros(len(solids.halves), dtype=layout.numpy_dtype())
        table["half"] = solids.halves
        table["first"] = -1
        first = 0
        for row, board in zip(table[len(solids.halves) - len(boards) :], boards, strict=True):
            row["first"], (row["height"], row["width"]) = first, board.print.shape
            first += board.print.size
        self._table = table

    def _trace(self, angle: float) -> None:
        """Find each pixel's first surface at an angle."""
        solids = self.scene.solids
        rotation, camera = self.placement.world_from_optical(angle)
        laser = camera + rotation @ self.placement.laser.origin
        local_from_optical = solids.world_from_local.transpose(0, 2, 1) @ rotation
        table = self._table.copy()  # a CPU device reads the one of the last angle in place
        table["local_from_optical"] = local_from_optical
        for name, point in (("camera", camera), ("laser", laser)):
            local = np.einsum("nji,nj->ni", solids.world_from_local, point - solids.centers)
            if np.any(np.all(np.abs(local) < solids.halves, axis=1)):
                raise InputError(
                    f"at {angle} degrees the {name} stands inside a solid of the scene, at "
                    f"{np.round(point, 3).tolist()}: move the head or the solid"
                )
            table[name] = local
        centers = (solids.centers - camera) @ rotation
        lists = solids_of_tiles(
            self._rays, local_from_optical.transpose(0, 2, 1), centers, solids.halves
        )
        self._solids = share(table, kernels.Solid, self.device)
        wp.launch(
            kernels.trace,
            dim=self._depth.shape,
            inputs=[
                self._slopes,
                self._solids,
                share(lists.first, wp.int32, self.device),
                share(lists.items, wp.int32, self.device),
                TILE,
                self._rays.tiles_across,
            ],
            outputs=[self._depth, self._surface],
            device=self.device,
        )
        self._traced = angle

    def _exposure_struct(self, shot: Shot) -> Any:
        laser, sensor = self.laser, self.sensor
        exposure: Any = kernels.Exposure()
        gain = 10.0 ** (shot.gain_db / 20.0)
        # The peak of the Gaussian at 1 m is 1 / (sqrt(2 pi) sigma): there the level is reached.
        peak = math.sqrt(2.0 * math.pi) * laser.sigma(1.0)
        exposure.ambient = self.scene.ambient * shot.exposure_us * gain
        exposure.sky = wp.vec3f(*SKY)
        exposure.laser = laser.level * shot.exposure_us * gain * peak if shot.laser_on else 0.0
        exposure.response = wp.vec3f(*laser.response)
        exposure.blur = sensor.blur
        exposure.speckle = math.sqrt(math.log1p(laser.speckle**2))  # of the logarithm
        exposure.read_variance = sensor.read_noise**2
        exposure.shot_variance = 255.0 / sensor.full_well * gain
        exposure.full_scale = float(2**sensor.bits - 1)
        exposure.mosaic = wp.vec4i(*MOSAICS.get(sensor.pixel_format, (0, 0, 0, 0)))
        angle = round(float(shot.angle), 6) + 0.0  # one zero, not two
        exposure.speckle_seed = self._stream("speckle", angle)
        exposure.noise_seed = self._stream(
            "noise", angle, shot.laser_on, shot.exposure_us, shot.gain_db, shot.number
        )
        return exposure

    def _stream(self, kind: str, *key: float) -> int:
        """A 32-bit seed, signed as Warp takes it, from the seed, the kind of noise and its key.

        The noise belongs to the state of the scanner and not to the count of frames before it:
        a scan that is resumed gets the frames that it would have got.
        """
        text = kind.encode() + np.array(key, dtype="<f8").tobytes()
        state = np.random.SeedSequence([self.seed, *text]).generate_state(1)
        return int(state.view(np.int32)[0])
