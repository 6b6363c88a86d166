"""The firmware double itself: it must be as unforgiving as the controllers that it stands for."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import serial

from depthwarp.errors import InputError
from depthwarp.scanner.axes import StepMotor
from depthwarp.scanner.twin.firmware import Firmware
from tests.scanner.axes.conftest import wait_until


class Client:
    """A bare serial line to the double."""

    def __init__(self, port: Any) -> None:
        self.port = port

    def say(self, text: str) -> None:
        self.port.write(text.encode())

    def hear(self) -> str:
        return str(self.port.readline().decode("ascii", "replace").strip())

    def ask(self, text: str) -> str:
        self.say(text + "\n")
        return self.hear()

    def status(self) -> str:
        self.say("?")
        return self.hear()


@contextmanager
def talk_to(firmware: Firmware) -> Iterator[Client]:
    with serial.serial_for_url(firmware.path, timeout=3.0) as port:
        yield Client(port)


def test_a_grbl_ok_means_planned_and_a_dwell_waits() -> None:
    """The trap that the driver has to avoid exists in the double."""
    with Firmware(time_scale=10.0) as firmware, talk_to(firmware) as client:
        assert client.ask("G1 X90 F1800") == "ok"
        assert firmware.true_angle < 45.0
        wait_until(lambda: client.status().startswith("<Run|MPos:"))
        assert client.ask("G4 P0.01") == "ok"
        assert not firmware.is_moving
        assert client.status().startswith("<Idle|MPos:90.000,0.000,0.000|FS:0,0")


def test_a_horus_ok_comes_after_the_motion() -> None:
    """And its status has the commas of 0.9."""
    with Firmware("horus", time_scale=10.0) as firmware, talk_to(firmware) as client:
        assert client.ask("G1 X90 F30") == "ok"
        assert not firmware.is_moving
        assert client.status() == "<Idle,MPos:90.000,0.000,0.000,WPos:90.000,0.000,0.000>"


def test_grbl_queues_moves_in_order() -> None:
    """Fifteen moves are planned ahead, the others wait for room; none is lost."""
    with Firmware(time_scale=500.0) as firmware, talk_to(firmware) as client:
        client.say("".join(f"G1 X{angle} F1800\n" for angle in range(9, 181, 9)))
        assert [client.hear() for _ in range(20)] == ["ok"] * 20
        assert client.ask("G4 P0.01") == "ok"
        assert firmware.true_angle == 180.0


def test_a_reset_in_motion_is_alarm_3() -> None:
    """Then everything is refused until `$X`, and the modes are the default ones."""
    with Firmware() as firmware, talk_to(firmware) as client:
        client.ask("G91")
        client.ask("M3 S1000")
        client.ask("G1 X90 F1800")
        assert firmware.laser_on
        client.say("\x18")
        heard = [client.hear() for _ in range(4)]
        assert heard == ["ALARM:3", "", "Grbl 1.1h ['$' for help]", "[MSG:'$H'|'$X' to unlock]"]
        assert not firmware.laser_on
        assert client.status().startswith("<Alarm|")
        assert client.ask("G1 X1 F60") == "error:9"
        assert client.ask("$X") == "[MSG:Caution: Unlocked]"
        assert client.hear() == "ok"
        assert client.ask("G1 X1") == "error:22"


def test_a_reset_at_rest_keeps_position_and_g54_but_not_g92() -> None:
    """What survives decides how the driver zeroes."""
    with Firmware(time_scale=500.0) as firmware, talk_to(firmware) as client:
        client.ask("G1 X45 F1800")
        client.ask("G10 L20 P1 X0")
        client.ask("G92 X9")
        client.say("\x18")
        assert [client.hear(), client.hear()] == ["", "Grbl 1.1h ['$' for help]"]
        assert client.ask("$#") == "[G54:45.000,0.000,0.000]"
        assert client.hear() == "[G92:0.000,0.000,0.000]"
        assert client.hear() == "ok"
        assert client.status().startswith("<Idle|MPos:45.000,")


def test_grbl_zeroes_at_the_angle_asked_for() -> None:
    """Not at the counted step, unless a reset came between: another trap."""
    with Firmware(time_scale=500.0) as firmware, talk_to(firmware) as client:
        client.ask("G1 X60 F1800")
        client.ask("G10 L20 P1 X0")
        assert client.ask("$#") == "[G54:60.000,0.000,0.000]"
        assert client.hear().startswith("[G92:")
        assert client.hear() == "ok"
        assert client.status().startswith("<Idle|MPos:59.962,")


def test_a_hold_brakes_and_a_cycle_start_goes_on() -> None:
    """The move ends where it should have ended."""
    with (
        Firmware(time_scale=8.0, motor=StepMotor(acceleration=60.0)) as firmware,
        talk_to(firmware) as client,
    ):
        client.ask("G1 X90 F1800")
        time.sleep(0.05)
        client.say("!")
        assert client.status().startswith("<Hold:1|")
        time.sleep(0.15)
        assert client.status().startswith("<Hold:0|")
        assert not firmware.is_moving
        client.say("~")
        assert client.ask("G4 P0.01") == "ok"
        assert firmware.true_angle == 90.0


@pytest.mark.parametrize(
    ("dialect", "line", "answer"),
    [
        ("grbl", "G1 X", "error:2"),
        ("grbl", "hello", "error:2"),
        ("grbl", "$Q", "error:3"),
        ("grbl", "", "ok"),
        ("horus", "G1 X", "error: Bad number format"),
        ("horus", "G21", "error: Unsupported command"),
        ("horus", "$Q", "error: Invalid statement"),
    ],
)
def test_what_it_does_not_know_is_refused(dialect: str, line: str, answer: str) -> None:
    """With the words of the real firmware."""
    with Firmware("grbl" if dialect == "grbl" else "horus") as firmware:
        with talk_to(firmware) as client:
            assert client.ask(line) == answer


def test_a_restart_counts_from_zero_where_the_head_is() -> None:
    """Nothing is heard while it boots; then the banner; the head has not moved."""
    with Firmware(time_scale=500.0, boot_s=0.2) as firmware, talk_to(firmware) as client:
        assert client.hear() == ""
        assert client.hear() == "Grbl 1.1h ['$' for help]"
        client.ask("G1 X45 F1800")
        client.ask("G4 P0.01")
        began = time.monotonic()
        firmware.restart()
        client.say("?")
        assert [client.hear(), client.hear()] == ["", "Grbl 1.1h ['$' for help]"]
        assert time.monotonic() - began > 0.15
        assert client.status().startswith("<Idle|MPos:0.000,")
        assert firmware.true_angle == 45.0


def test_the_name_of_the_port_survives_a_dropped_line() -> None:
    """As a device name does when the same plug comes back."""
    with Firmware() as firmware:
        firmware.drop_line()
        firmware.drop_line()
        with pytest.raises(serial.SerialException):
            serial.serial_for_url(firmware.path)
        firmware.restore_line()
        firmware.restore_line()
        with talk_to(firmware) as client:
            assert client.status().startswith("<Idle|")


def test_the_truth_can_be_asked_for_after_the_end() -> None:
    """Closing twice does no harm either."""
    firmware = Firmware(time_scale=500.0)
    with talk_to(firmware) as client:
        client.ask("G1 X45 F1800")
        client.ask("M3 S1")
    firmware.close()
    firmware.close()
    assert (firmware.true_angle, firmware.laser_on, firmware.is_moving) == (45.0, True, False)


def test_a_client_that_does_not_read_does_not_block_it() -> None:
    """What nobody reads is lost, the double lives on."""
    with Firmware() as firmware, talk_to(firmware) as client:
        for _ in range(2000):
            client.say("?")
        assert firmware.true_angle == 0.0


def test_impossible_settings_are_refused() -> None:
    """Dialect and pace."""
    with pytest.raises(InputError, match="dialect"):
        Firmware("marlin")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="time_scale"):
        Firmware(time_scale=0.0)
