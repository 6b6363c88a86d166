"""Every way out leaves the laser off and the motor still."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from depthwarp.scanner.axes import AxisStoppedError
from depthwarp.scanner.axis import AxisState
from tests.scanner.axes.conftest import MakeRig, Rig, build_axis, wait_until

FAR = 3600.0


def assert_stopped(rig: Rig, since: int) -> None:
    """The double saw a feed hold, a reset and the laser's off, and is at rest."""
    seen = rig.firmware.received[since:]
    assert seen.index("!") < seen.index("\x18") < min(map(seen.index, rig.laser_off_lines))
    assert not rig.firmware.laser_on
    assert not rig.firmware.is_moving


@pytest.mark.parametrize("error", [KeyError, KeyboardInterrupt, SystemExit])
def test_an_exception_in_the_block(rig: Rig, error: type[BaseException]) -> None:
    """Whatever is raised in a `with` block, the double saw the stop."""
    since = 0
    with pytest.raises(error), rig.axis:
        rig.axis.set_laser(True)
        since = len(rig.firmware.received)
        raise error
    assert_stopped(rig, since)


def test_stop_from_another_thread_ends_a_move(rig: Rig) -> None:
    """`move_to` raises where it waits, soon, and nothing of it is sent afterwards."""
    rig.axis.set_laser(True)
    ended: list[BaseException] = []

    def move() -> None:
        try:
            rig.axis.move_to(FAR)
        except AxisStoppedError as error:
            ended.append(error)

    mover = threading.Thread(target=move)
    mover.start()
    wait_until(lambda: rig.firmware.is_moving)
    since = len(rig.firmware.received)
    began = time.monotonic()
    rig.axis.stop()
    mover.join()
    assert time.monotonic() - began < 2.0
    assert len(ended) == 1
    assert_stopped(rig, since)
    assert not any("X" in line for line in rig.firmware.received[since:])
    assert rig.axis.state() is AxisState.ALARM  # laser on: reset at once, in the middle of motion


def test_a_stop_with_the_laser_off_keeps_the_position(rig: Rig) -> None:
    """The motor brakes by its ramp, so the angles still hold."""
    mover = threading.Thread(target=pytest.raises, args=(AxisStoppedError, rig.axis.move_to, FAR))
    mover.start()
    wait_until(lambda: rig.firmware.is_moving)
    rig.axis.stop()
    mover.join()
    assert rig.axis.position() == pytest.approx(rig.firmware.true_angle, abs=0.001)
    assert rig.axis.move_to(0.0) == 0.0 == rig.firmware.true_angle


def test_stops_may_come_from_many_threads_and_at_any_time(rig: Rig) -> None:
    """Four at once, in a move, and none is taken for a restart."""
    mover = threading.Thread(target=pytest.raises, args=(AxisStoppedError, rig.axis.move_to, FAR))
    mover.start()
    wait_until(lambda: rig.firmware.is_moving)
    stoppers = [threading.Thread(target=rig.axis.stop) for _ in range(4)]
    for stopper in stoppers:
        stopper.start()
    for thread in (*stoppers, mover):
        thread.join()
    assert rig.axis.move_to(0.0) == 0.0 == rig.firmware.true_angle


def test_an_interrupt_in_a_move_stops_it(rig: Rig) -> None:
    """Ctrl-C inside `move_to`, without any `with` block."""
    since = len(rig.firmware.received)

    def press_ctrl_c() -> None:
        wait_until(lambda: rig.firmware.is_moving)
        os.kill(os.getpid(), signal.SIGINT)

    presser = threading.Thread(target=press_ctrl_c)
    with pytest.raises(KeyboardInterrupt):
        presser.start()
        rig.axis.move_to(FAR)
    presser.join()
    assert_stopped(rig, since)


def test_a_forgotten_axis_leaves_the_machine_safe(make_rig: MakeRig) -> None:
    """Garbage collection stops, as closing would."""
    rig = make_rig()
    axis = build_axis("grbl", rig.firmware.path)
    axis.connect()
    axis.set_laser(True)
    since = len(rig.firmware.received)
    del axis
    gc.collect()
    assert_stopped(rig, since)


PROGRAM = """
import sys
from depthwarp.scanner.axes import GrblAxis
axis = GrblAxis(sys.argv[1])
axis.connect()
axis.set_laser(True)
print("laser on", flush=True)
"""


def test_a_program_that_ends_without_closing(make_rig: MakeRig) -> None:
    """The end of the interpreter stops the machine too."""
    rig = make_rig()
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, rig.firmware.path],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "laser on" in done.stdout
    assert "M3 S1000" in rig.firmware.received
    assert_stopped(rig, rig.firmware.received.index("M3 S1000"))


def test_stop_and_close_never_raise(rig: Rig) -> None:
    """Twice, out of order, on a dead line, before connecting."""
    rig.firmware.drop_line()
    rig.axis.stop()
    rig.axis.close()
    rig.axis.close()
    rig.axis.stop()
    fresh = build_axis("grbl", "/dev/none")
    fresh.stop()
    fresh.close()
