"""A Basler camera through pylon, the vendor's SDK; its emulated cameras take the same path."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from depthwarp.errors import InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameError,
    FrameTimeoutError,
    IncompleteFrameError,
    PixelFormat,
    SourceInfo,
)
from depthwarp.scanner.sources.base import UprightSource
from depthwarp.scanner.sources.basler_sdk import (
    EMULATION,
    EXPOSURE_NAMES,
    GAIN_NAMES,
    NumberControl,
    SensorFormat,
    choose_format,
    find_device,
    load_sdk,
    removal_listener,
    sdk_words,
    set_feature,
)

__all__ = ["BaslerSource"]

LONGEST_WAIT_MS = 200
"""Longest time without a look at whether the camera is still there, or at a signal."""

MANUAL = {
    "ExposureAuto": "Off",
    "GainAuto": "Off",
    "BalanceWhiteAuto": "Off",
    "ExposureMode": "Timed",
}
"""What must hold, where a camera has it, for exposure and gain to be those that were set."""


class BaslerSource(UprightSource):
    """One software trigger, one frame, raw as the sensor has it.

    Once opened, the source stays with the camera of that serial number: after `DeviceLostError`,
    `open` finds the same one again. Frames begin with the camera's own settings; automatic
    exposure, gain and white balance are switched off.

    Args:
        serial: Serial number; None takes the only camera there is.
        rotation: How far the camera is rolled, clockwise seen from behind it [degrees].
        pixel_format: Format of the raw frames; None takes the best: Bayer, BGR, grey.
        bits: Bits of a number; None takes the most that the camera sends.
        features: Other settings by the names that the SDK has for them, in the order to set them:
            `{"Width": 2590, "Height": 1942}`.
    """

    def __init__(
        self,
        serial: str | None = None,
        *,
        rotation: int = 0,
        pixel_format: PixelFormat | None = None,
        bits: int | None = None,
        features: Mapping[str, bool | int | float | str] | None = None,
    ) -> None:
        super().__init__("Basler camera" + (f" {serial}" if serial else ""), rotation)
        self._serial = serial
        self._wanted_format, self._wanted_bits = pixel_format, bits
        self._features = dict(features or {})
        self._pylon: Any = None
        self._camera: Any = None
        self._removal: Any = None
        self._late = False

    def open(self) -> SourceInfo:
        """Take the camera, set it up and make it wait for triggers.

        Raises:
            MissingExtraError: pypylon is not installed.
            InputError: There is no such camera, or it does not take a format or feature.
            FrameError: It is there but cannot be used.
        """
        if self._info is not None:
            return self._info
        pylon = self._pylon = load_sdk()
        device = find_device(pylon, self._serial)
        self._serial = str(device.GetSerialNumber())
        self.label = f"Basler camera {self._serial} ({device.GetModelName()})"
        try:
            factory = pylon.TlFactory.GetInstance()
            self._camera = pylon.InstantCamera(factory.CreateDevice(device))
            self._removal = removal_listener(pylon)
            self._camera.RegisterConfiguration(
                self._removal, pylon.RegistrationMode_Append, pylon.Cleanup_None
            )
            self._camera.Open()
            self._set_up()
            self._camera.StartGrabbing(pylon.GrabStrategy_OneByOne)
        except pylon.GenericException as error:
            self.close()
            raise FrameError(
                f"{self.label} cannot be used: {sdk_words(error)}; close other programs that use it"
            ) from error
        except BaseException:
            self.close()
            raise
        return self._opened_as(
            name=f"{device.GetVendorName()} {device.GetModelName()}",
            serial=self._serial,
            raw_size=self._raw_size,
            raw_format=self._format.pixel_format,
            is_emulated=device.GetDeviceClass() == EMULATION,
        )

    def close(self) -> None:
        """Give the camera back; harmless when it is not open, or gone."""
        camera, self._camera, self._info = self._camera, None, None
        if camera is None:
            return
        # A camera that is gone refuses some of these; the others are still needed.
        for step in (
            camera.StopGrabbing,
            lambda: camera.DeregisterConfiguration(self._removal),
            camera.DestroyDevice,  # closes it, too
        ):
            with suppress(self._pylon.GenericException):
                step()

    def settings(self) -> str:
        """All settings of the camera as they were after opening, in the SDK's own text form.

        `pylon.FeaturePersistence.LoadFromString` gives them back to a camera of this model. What
        changes later, exposure and gain, is in the frames.
        """
        self._require_open()
        return self._settings

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Set exposure and gain; NaN leaves one as it is. Nothing is set if one is refused.

        Raises:
            InputError: Out of the camera's range. On older cameras, which count gain in a unit
                of their own, any gain but 0, which is their lowest.
            DeviceLostError: The camera is gone.
        """
        self._require_open()
        with self._sdk_errors():
            self._check_present()
            changes = []
            if not math.isnan(exposure_us):
                value = self._exposure.checked("exposure_us", exposure_us, self.label)
                changes.append((self._exposure, value))
            if not math.isnan(gain_db):
                changes.append((self._gain, self._gain_value(gain_db)))
            for control, value in changes:
                control.value = value
            self._read_back()

    def grab(self, timeout_s: float) -> Frame:
        """Trigger one exposure and wait for its frame.

        Raises:
            FrameTimeoutError: Nothing came in time.
            IncompleteFrameError: The frame is damaged, or has another size than the camera said.
            DeviceLostError: The camera is gone; it is closed.
        """
        self._require_open()
        deadline = time.monotonic() + timeout_s
        with self._sdk_errors():
            self._check_present()
            if self._late:
                # What an earlier trigger took must not pass for what this one takes.
                self._camera.StopGrabbing()
                self._camera.StartGrabbing(self._pylon.GrabStrategy_OneByOne)
            self._late = True  # until the frame is here, on every way out
            result = self._triggered(deadline)
            if result is None:
                self._check_present(by_listing=True)
                raise FrameTimeoutError(
                    f"{self.label} sent no frame within {timeout_s:.3g} s: allow more time than "
                    "its exposure and transfer take, or check its cable"
                )
            host_time_ns = time.time_ns()
            self._late = False
            try:
                self._check_complete(result)
                pixels, ticks = result.GetArray(), int(result.GetTimeStamp())
            finally:
                result.Release()
        return self._upright_frame(
            pixels,
            self._format.bits,
            exposure_us=self._exposure_us,
            gain_db=self._gain_db,
            host_time_ns=host_time_ns,
            # A camera without a clock, as the emulated one, always says 0.
            camera_time_ns=ticks * 10**9 // self._ticks_a_second if ticks else None,
        )

    def _set_up(self) -> None:
        """Bring the open camera into the state that scanning needs."""
        pylon, nodes = self._pylon, self._camera.GetNodeMap()
        for name, value in self._features.items():
            set_feature(pylon, nodes, name, value, self.label)
        pixel_format = nodes.GetNode("PixelFormat")
        self._format: SensorFormat = choose_format(
            filter(pixel_format.CanSetValue, pixel_format.Symbolics),
            self._wanted_format,
            self._wanted_bits,
            self.label,
        )
        pixel_format.SetValue(self._format.name)
        for name, value in MANUAL.items():
            node = nodes.GetNode(name)
            if node is not None and node.IsWritable():
                node.SetValue(value)
        pylon.SoftwareTriggerConfiguration.ApplyConfiguration(nodes)
        self._exposure = NumberControl(nodes, EXPOSURE_NAMES)
        self._gain = NumberControl(nodes, GAIN_NAMES)
        self._read_back()
        # Older GigE cameras count ticks of a frequency that they tell; all others nanoseconds.
        ticks_a_second = NumberControl(nodes, ("GevTimestampTickFrequency",)).value
        self._ticks_a_second = 10**9 if math.isnan(ticks_a_second) else round(ticks_a_second)
        self._raw_size = (
            int(nodes.GetNode("Width").GetValue()),
            int(nodes.GetNode("Height").GetValue()),
        )
        self._settings = str(pylon.FeaturePersistence.SaveToString(nodes))
        self._late = False

    def _gain_value(self, gain_db: float) -> float:
        """What the camera's gain control must be set to."""
        if self._gain.name != "GainRaw":
            return self._gain.checked("gain_db", gain_db, self.label)
        if gain_db != 0:
            raise InputError(
                f"gain_db must be 0 (the lowest) on {self.label}, which counts gain in a unit of "
                f"its own, got {gain_db}: choose a longer exposure, or set the feature 'GainRaw'"
            )
        return self._gain.lowest

    def _read_back(self) -> None:
        """Ask the camera what exposure and gain it really has."""
        self._exposure_us = self._exposure.value
        self._gain_db = self._gain.value if self._gain.name == "Gain" else math.nan

    def _triggered(self, deadline: float) -> Any:
        """Trigger when the camera is ready; its result, or None when it did not come in time."""
        pylon, camera = self._pylon, self._camera
        silent = pylon.TimeoutHandling_Return
        if camera.CanWaitForFrameTriggerReady():
            for wait_ms in self._slices(deadline):
                if camera.WaitForFrameTriggerReady(wait_ms, silent):
                    break
            else:
                return None
        camera.ExecuteSoftwareTrigger()
        for wait_ms in self._slices(deadline):
            result = camera.RetrieveResult(wait_ms, silent)
            if result.IsValid():
                return result
        return None

    def _slices(self, deadline: float) -> Iterator[int]:
        """Times to wait [ms] until the deadline, at least one; a lost camera ends them.

        The SDK's waits do not end when the camera is lost, or for Ctrl-C: so they must be short.
        """
        while True:
            left_ms = max(0, math.ceil((deadline - time.monotonic()) * 1e3))
            yield min(left_ms, LONGEST_WAIT_MS)
            self._check_present()
            if left_ms <= LONGEST_WAIT_MS:
                return

    def _check_complete(self, result: Any) -> None:
        """Refuse a result that is not a whole frame of the size that the camera said."""
        if not result.GrabSucceeded():
            raise IncompleteFrameError(
                f"{self.label} sent a frame that is not whole: "
                f"{result.GetErrorDescription().rstrip('.')}; grab again, and if it comes again, "
                "check the cable and the load on its bus"
            )
        size = (result.GetWidth(), result.GetHeight())
        if size != self._raw_size:
            raise IncompleteFrameError(
                f"{self.label} sent a frame of {size[0]} x {size[1]} pixels, but it is set to "
                f"{self._raw_size[0]} x {self._raw_size[1]}: set 'Width' and 'Height' to fit"
            )

    def _check_present(self, by_listing: bool = False) -> None:
        """Make sure that the camera is still there.

        The SDK's word that a camera was removed does not always come, so after a timeout the list
        of cameras is looked at, too.
        """
        gone = self._removal.happened.is_set() or self._camera.IsCameraDeviceRemoved()
        if not gone and by_listing:
            devices = self._pylon.TlFactory.GetInstance().EnumerateDevices()
            gone = all(device.GetSerialNumber() != self._serial for device in devices)
        if gone:
            self.close()
            raise DeviceLostError(f"{self.label} was removed: plug it in and open it again")

    @contextmanager
    def _sdk_errors(self) -> Iterator[None]:
        """Take what the SDK raises in the midst of work as the loss of the camera."""
        try:
            yield
        except self._pylon.GenericException as error:
            self.close()
            raise DeviceLostError(
                f"{self.label} does not work any more: {sdk_words(error)}; check its cable and "
                "power, and open it again"
            ) from error
