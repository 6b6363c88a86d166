"""Basler's SDK: loading it, finding cameras, pixel formats, both generations of names."""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Iterable
from threading import Event
from typing import Any, NamedTuple

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.sources.base import CameraEntry

__all__ = [
    "NumberControl",
    "SensorFormat",
    "choose_format",
    "find_device",
    "list_basler_cameras",
    "load_sdk",
    "removal_listener",
    "sdk_words",
    "set_feature",
]

EXPOSURE_NAMES = ("ExposureTime", "ExposureTimeAbs")
"""Exposure time [microseconds], as newer and as older cameras call it."""

GAIN_NAMES = ("Gain", "GainRaw")
"""Gain: in dB, and in a unit of the older camera's own that no common formula converts."""

EMULATION = "BaslerCamEmu"
"""Device class of the SDK's emulated cameras (environment variable `PYLON_CAMEMU`)."""


class SensorFormat(NamedTuple):
    """One of the camera's pixel formats, by its name in the SDK."""

    name: str
    pixel_format: PixelFormat
    bits: int


FORMATS = (
    *(
        SensorFormat(f"Bayer{letters}{bits}", pixel_format, bits)
        for bits in (12, 10, 8)
        for letters, pixel_format in (
            ("RG", PixelFormat.BAYER_RGGB),
            ("GB", PixelFormat.BAYER_GBRG),
            ("GR", PixelFormat.BAYER_GRBG),
            ("BG", PixelFormat.BAYER_BGGR),
        )
    ),
    SensorFormat("BGR8", PixelFormat.BGR, 8),
    SensorFormat("BGR8Packed", PixelFormat.BGR, 8),  # the same by its older name
    *(SensorFormat(f"Mono{bits}", PixelFormat.MONO, bits) for bits in (12, 10, 8)),
)
"""Formats that become frames, the best first: raw colours with many bits, then what is left."""


def load_sdk() -> Any:
    """The module `pypylon.pylon`.

    Raises:
        MissingExtraError: pypylon is not installed.
    """
    try:
        # Its import warns from C, and crashes the interpreter where warnings are errors.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module("pypylon.pylon")
    except ModuleNotFoundError as error:
        raise MissingExtraError("a Basler camera", "pypylon", "basler") from error


def sdk_words(error: Exception) -> str:
    """What the SDK says, without the place in its own sources."""
    return str(error).split(" : ")[0].strip().rstrip(".")


def list_basler_cameras(pylon: Any) -> list[CameraEntry]:
    """Basler cameras that the SDK sees, emulated ones included."""
    return [
        CameraEntry(
            spec=f"basler:{device.GetSerialNumber()}",
            name=device.GetModelName(),
            is_emulated=device.GetDeviceClass() == EMULATION,
        )
        for device in pylon.TlFactory.GetInstance().EnumerateDevices()
    ]


def find_device(pylon: Any, serial: str | None) -> Any:
    """The SDK's entry of one camera: that with the serial number, or the only one there is.

    Raises:
        InputError: There is none, or several and no serial number.
    """
    devices = list(pylon.TlFactory.GetInstance().EnumerateDevices())
    there_are = ", ".join(f"basler:{d.GetSerialNumber()} ({d.GetModelName()})" for d in devices)
    if not devices:
        raise InputError(
            "no Basler camera was found: check its cable and power, and for GigE its IP address; "
            "PYLON_CAMEMU=1 in the environment gives an emulated one"
        )
    if serial is None:
        if len(devices) > 1:
            raise InputError(f"there are several Basler cameras, choose one: {there_are}")
        return devices[0]
    for device in devices:
        if device.GetSerialNumber() == serial:
            return device
    raise InputError(f"no Basler camera has the serial number '{serial}'; there are {there_are}")


def choose_format(
    offered: Iterable[str], pixel_format: PixelFormat | None, bits: int | None, label: str
) -> SensorFormat:
    """The best format that a camera offers and that fits what is asked for.

    Raises:
        InputError: There is none.
    """
    names = set(offered)
    usable = [known for known in FORMATS if known.name in names]
    for known in usable:
        if pixel_format in (None, known.pixel_format) and bits in (None, known.bits):
            return known
    raise InputError(
        f"{label} has no pixel format {pixel_format or 'of any kind'}"
        f"{'' if bits is None else f' with {bits} bits'} that becomes frames; "
        f"it has {', '.join(f'{k.name} ({k.pixel_format}, {k.bits} bits)' for k in usable)}"
    )


def set_feature(
    pylon: Any, node_map: Any, name: str, value: bool | int | float | str, label: str
) -> None:
    """Set one of the camera's features by the name that the SDK has for it.

    Raises:
        InputError: There is no such feature, or it does not take the value.
    """
    try:
        node_map.GetNode(name).Value = value
    except (pylon.GenericException, TypeError) as error:
        said = sdk_words(error) if isinstance(error, pylon.GenericException) else "wrong type"
        raise InputError(
            f"{label} does not take {value!r} for its feature '{name}': {said}"
        ) from error


def removal_listener(pylon: Any) -> Any:
    """A listener of the SDK whose event `happened` is set when the camera is removed."""

    class RemovalListener(pylon.ConfigurationEventHandler):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__()
            self.happened = Event()

        def OnCameraDeviceRemoved(self, camera: Any) -> None:
            self.happened.set()

    return RemovalListener()


class NumberControl:
    """One control of the camera under whichever name it has: its range, its value.

    Args:
        node_map: The camera's features.
        names: Names to look for, in this order.
    """

    def __init__(self, node_map: Any, names: Iterable[str]) -> None:
        self.name = ""
        self._node: Any = None
        for name in names:
            node = node_map.GetNode(name)
            if node is not None and node.IsReadable():
                self.name, self._node = name, node
                break

    def checked(self, argument: str, value: float, label: str) -> float:
        """Return `value` if the camera can take it.

        Raises:
            InputError: It is out of the camera's range.
        """
        if self._node is None:
            raise InputError(f"{label} has no control for {argument}: give NaN to leave it")
        low, high = self._node.GetMin(), self._node.GetMax()
        if not low <= value <= high:  # written so that NaN fails
            raise InputError(f"{argument} must be from {low:g} to {high:g} on {label}, got {value}")
        return value

    @property
    def lowest(self) -> float:
        """The smallest value that the camera takes."""
        return math.nan if self._node is None else float(self._node.GetMin())

    @property
    def value(self) -> float:
        """The value that the camera has; NaN without such a control."""
        return math.nan if self._node is None else float(self._node.GetValue())

    @value.setter
    def value(self, value: float) -> None:
        if self._node is not None:
            whole = isinstance(self._node.GetMin(), int)
            self._node.SetValue(round(value) if whole else float(value))
