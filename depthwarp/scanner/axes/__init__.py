"""Motor axes: GRBL 1.1 and Horus controllers on a serial line, a person, and a simulation."""

from __future__ import annotations

from collections.abc import Callable

from depthwarp.errors import InputError
from depthwarp.scanner.axes.controller import AxisStoppedError
from depthwarp.scanner.axes.grbl import GrblAxis
from depthwarp.scanner.axes.horus import HorusAxis
from depthwarp.scanner.axes.manual import ManualAxis
from depthwarp.scanner.axes.motor import StepMotor
from depthwarp.scanner.axes.ports import describe_ports
from depthwarp.scanner.axes.simulated import SimulatedAxis
from depthwarp.scanner.axis import Axis

__all__ = [
    "AxisStoppedError",
    "GrblAxis",
    "HorusAxis",
    "ManualAxis",
    "SimulatedAxis",
    "StepMotor",
    "open_axis",
]

_SERIAL: dict[str, type[GrblAxis] | type[HorusAxis]] = {"grbl": GrblAxis, "horus": HorusAxis}


def open_axis(
    spec: str,
    *,
    ask: Callable[[str], float | None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Axis:
    """Make the axis that a text describes; `connect` or a `with` block opens it.

    Args:
        spec: `grbl:PORT`, `horus:PORT`, `manual` or `simulated`. A port is anything that
            `serial.serial_for_url` takes, such as `/dev/ttyUSB0` or `socket://host:port`;
            or `serial:NUMBER`, the port with that USB serial number, wherever it is plugged in.
        ask: For `manual`: see `ManualAxis`.
        tell: For `manual`: see `ManualAxis`.

    Raises:
        InputError: Another kind of axis, a port that is missing or out of place, or `manual`
            with nobody to ask.

    Example:
        >>> with open_axis("simulated") as axis:
        ...     axis.move_to(90.0)
        90.0
    """
    kind, colon, port = spec.partition(":")
    if kind in _SERIAL:
        if not port:
            raise InputError(f"axis {spec!r} lacks its port, as in {kind}:PORT; {describe_ports()}")
        return _SERIAL[kind](port)
    if kind == "simulated" and not colon:
        return SimulatedAxis()
    if kind == "manual" and not colon:
        if ask is None or tell is None:
            raise InputError("axis 'manual' needs a person: give both ask and tell")
        return ManualAxis(ask, tell)
    raise InputError(
        f"axis must be grbl:PORT, horus:PORT, manual or simulated, got {spec!r}; {describe_ports()}"
    )
