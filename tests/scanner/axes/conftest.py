"""A firmware double for each dialect, and the watch over what a test leaves behind."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

from depthwarp.scanner.axes import GrblAxis, HorusAxis
from depthwarp.scanner.axes.motor import StepMotor
from depthwarp.scanner.twin.firmware import Firmware

TIME_SCALE = 20.0
PATIENCE_S = 4.0  # that of the library: never used up where all is well
SHORT_S = 0.3  # where it is used up on purpose


@dataclass
class Rig:
    """An axis and the firmware at the other end of its line."""

    dialect: Literal["grbl", "horus"]
    firmware: Firmware
    axis: GrblAxis | HorusAxis

    @property
    def laser_off_lines(self) -> set[str]:
        return {"M5"} if self.dialect == "grbl" else {"M70 T1", "M70 T2"}


MakeRig = Callable[..., Rig]


def build_axis(dialect: str, port: str, patience_s: float = PATIENCE_S) -> GrblAxis | HorusAxis:
    kind = GrblAxis if dialect == "grbl" else HorusAxis
    return kind(port, speed=90.0, patience_s=patience_s)


@pytest.fixture
def make_rig() -> Iterator[MakeRig]:
    """A function that makes rigs whose axes are not connected yet."""
    with ExitStack() as stack:

        def make(
            dialect: Literal["grbl", "horus"] = "grbl",
            *,
            time_scale: float = TIME_SCALE,
            boot_s: float = 0.0,
            patience_s: float = PATIENCE_S,
            motor: StepMotor | None = None,
        ) -> Rig:
            firmware = stack.enter_context(
                Firmware(dialect, motor=motor, time_scale=time_scale, boot_s=boot_s)
            )
            axis = build_axis(dialect, firmware.path, patience_s)
            stack.callback(axis.close)
            return Rig(dialect, firmware, axis)

        yield make


@pytest.fixture(params=["grbl", "horus"])
def rig(request: pytest.FixtureRequest, make_rig: MakeRig) -> Rig:
    """A connected and referenced axis of each dialect."""
    rig = make_rig(request.param)
    rig.axis.connect()
    rig.axis.reference()
    return rig


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """Every test of this folder ends with the threads and open files that it began with."""
    threads, files = threading.active_count(), count_open_files()
    yield
    assert threading.active_count() == threads, threading.enumerate()
    assert count_open_files() == files


def wait_until(condition: Callable[[], object], timeout_s: float = 5.0) -> None:
    """Wait for what another thread brings about."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def count_open_files() -> int:
    folder = Path("/proc/self/fd")
    return len(os.listdir(folder)) if folder.is_dir() else 0
