"""What the twin's light and sensor are like: the laser's fan and beam, the sensor's noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

from depthwarp.checks import check_finite_vector, check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat

__all__ = ["Laser", "Sensor"]


@dataclass(frozen=True)
class Laser:
    """A line laser, its power spread evenly over the angles of a fan.

    The light on a surface at distance r from the laser, met under the angle i from its normal, is
    `cos(i) / r` a length of the line times a Gaussian across it of standard deviation
    `sigma(r) = hypot(waist, divergence r)`: its peak falls like 1 / r^2 once the beam diverges.
    What a pixel sees is that times the surface's green reflectance; an image does not get darker
    with the camera's own distance.

    Attributes:
        level: Grey levels (of 255) a microsecond, at the peak of the line on a white surface that
            faces the laser 1 m away. The default goes with 200 mW beside a room of 500 lx.
        waist: Standard deviation of the beam across the line, at the laser [m].
        divergence: Growth of that standard deviation [rad].
        fan: Opening angle [degrees], centred on the viewing side, square to the turning axis.
        response: What a red, green and blue pixel make of the light. The crosstalk into red and
            blue is what turns the core of a saturated line white.
        speckle: Contrast (standard deviation over mean) of the speckle, log-normal and independent
            from pixel to pixel; it stays the same as long as the head does not turn.
    """

    level: float = 1.0
    waist: float = 0.5e-3
    divergence: float = 0.5e-3
    fan: float = 90.0
    response: tuple[float, float, float] = (0.14, 1.0, 0.12)
    speckle: float = 0.0

    def __post_init__(self) -> None:
        check_positive("laser.level", self.level, "grey levels a microsecond")
        check_positive("laser.waist", self.waist, "m")
        _check_at_least_0("laser.divergence", self.divergence)
        _check_at_least_0("laser.speckle", self.speckle)
        if not 0 < self.fan < 180:
            raise InputError(f"laser.fan must be between 0 and 180 degrees, got {self.fan}")
        if min(check_finite_vector("laser.response", self.response, 3)) < 0:
            raise InputError(f"laser.response must not be negative, got {self.response}")

    def sigma(self, distance: float) -> float:
        """Standard deviation of the beam across the line [m] at a distance from the laser [m]."""
        return math.hypot(self.waist, self.divergence * distance)


@dataclass(frozen=True)
class Sensor:
    """A sensor with shot noise and read noise that answers linearly up to full scale.

    Noise is stated in grey levels of 255, whatever the number of bits.

    Attributes:
        pixel_format: Bayer mosaic or BGR.
        bits: Bits of a pixel, 8 to 16; above 8 the frames are uint16.
        read_noise: Standard deviation in the dark [grey levels of 255].
        full_well: Electrons at full scale and 0 dB; infinite for no shot noise.
        blur: Standard deviation of the lens's blur [px], applied to the laser line and to boards.
    """

    pixel_format: PixelFormat = PixelFormat.BAYER_RGGB
    bits: int = 8
    read_noise: float = 1.5
    full_well: float = 8000.0
    blur: float = 0.6

    def __post_init__(self) -> None:
        if self.pixel_format is PixelFormat.MONO:
            raise InputError(
                "sensor.pixel_format must be a Bayer mosaic or bgr: the twin has colours"
            )
        if self.bits not in range(8, 17):
            raise InputError(f"sensor.bits must be a whole number from 8 to 16, got {self.bits}")
        _check_at_least_0("sensor.read_noise", self.read_noise)
        _check_at_least_0("sensor.blur", self.blur)
        if not self.full_well > 0:
            raise InputError(f"sensor.full_well must be above 0 electrons, got {self.full_well}")

    def quiet(self) -> Sensor:
        """The same sensor without noise."""
        return Sensor(self.pixel_format, self.bits, 0.0, math.inf, self.blur)


def _check_at_least_0(name: str, value: float) -> None:
    if not 0 <= value < math.inf:
        raise InputError(f"{name} must be a finite number, at least 0, got {value}")
