"""A person at the terminal of a scan: pause, Ctrl-Z, Ctrl-C, and questions by hand."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.sources import FolderSource
from depthwarp.scanner.twin import TwinRenderer
from depthwarp.scanner.twin.firmware import Firmware
from depthwarp.scanner.twin.scene import Scene
from depthwarp.scanner.twin.session import TWIN_POSITION, twin_calibration
from tests.cli.terminal import Terminal, on_terminal

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="looks at the process in /proc: Linux only"
)

STOPS = 40


@pytest.fixture(scope="module")
def camera(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Options for a camera that is a folder of small pictures, with a calibration."""
    folder = tmp_path_factory.mktemp("camera")
    geometry = reference_geometry(0.05)
    width, height = geometry.lens.size
    for number in range(2 * STOPS):
        cv2.imwrite(
            str(folder / f"f{number:03d}.png"), np.full((height, width, 3), number, np.uint8)
        )
    renderer = TwinRenderer(Scene(furnished_room()), geometry, TWIN_POSITION)
    with FolderSource(folder) as source:
        twin_calibration(renderer, source.open()).save(folder / "c.json")
    return ("--camera", f"folder:{folder}", "--calibration", str(folder / "c.json"))


@pytest.fixture
def firmware() -> Iterator[Firmware]:
    """A controller on a pseudo terminal."""
    with Firmware(time_scale=10.0) as firmware:
        yield firmware


@pytest.fixture
def scan(firmware: Firmware, camera: tuple[str, ...], tmp_path: Path) -> Iterator[Terminal]:
    """A scan under way, with keys, in the folder `scan`; a stop takes tenths of a second."""
    options = ("--stops", STOPS, "--settle", 0)
    with on_terminal(
        "scan", "-o", tmp_path / "scan", "--axis", f"grbl:{firmware.path}", *camera, *options
    ) as terminal:
        terminal.wait_for("space pauses")
        firmware.answer_delay_s = 0.03
        terminal.wait_until(lambda: stops_done(tmp_path) > 1)
        yield terminal


def stops_done(folder: Path) -> int:
    """Lines of the journal."""
    journal = folder / "scan" / "journal.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def assert_rests(terminal: Terminal, firmware: Firmware, folder: Path) -> None:
    """For a while nothing moves, no stop is added, and the laser is off."""
    done, heard = stops_done(folder), len(firmware.received)
    until = iter(range(20))
    terminal.wait_until(lambda: next(until, None) is None)
    assert not firmware.laser_on and not firmware.is_moving
    assert (stops_done(folder), len(firmware.received)) == (done, heard)


def test_a_key_pauses_and_goes_on(scan: Terminal, firmware: Firmware, tmp_path: Path) -> None:
    """The head stands, the laser is off, the line says so; space and p do the same."""
    scan.press(" ")
    scan.wait_for("paused, laser off (space goes on)")
    assert_rests(scan, firmware, tmp_path)
    done = stops_done(tmp_path)
    assert 0 < done < STOPS
    scan.press("p")
    scan.wait_until(lambda: stops_done(tmp_path) > done)
    scan.press("\x03")
    assert scan.wait_for_end() == 2
    assert "--resume continues it" in scan.screen
    assert scan.settings == scan.settings_before
    assert not firmware.laser_on


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGQUIT])
def test_a_signal_ends_a_paused_scan(
    scan: Terminal, firmware: Firmware, tmp_path: Path, number: signal.Signals
) -> None:
    """No key is needed first; recording and terminal are whole."""
    scan.press(" ")
    scan.wait_for("paused, laser off")
    scan.process.send_signal(number)
    assert scan.wait_for_end() == 2, scan.screen
    assert scan.settings == scan.settings_before
    assert len(Recording.open(tmp_path / "scan").finished) == stops_done(tmp_path)


def test_ctrl_z_stops_the_process_only_when_the_scan_rests(
    scan: Terminal, firmware: Firmware, tmp_path: Path
) -> None:
    """Laser off, terminal as it was; continued, the scan goes on and keys work again."""
    scan.press("\x1a\x1a")
    scan.wait_until(lambda: scan.is_stopped)
    assert scan.settings == scan.settings_before
    assert_rests(scan, firmware, tmp_path)
    done = stops_done(tmp_path)
    assert done < STOPS
    scan.process.send_signal(signal.SIGCONT)
    scan.wait_until(lambda: stops_done(tmp_path) > done)
    scan.wait_until(lambda: scan.settings != scan.settings_before)
    scan.press(" ")
    scan.wait_for("paused, laser off")
    scan.press("\x1a")
    scan.wait_until(lambda: scan.is_stopped)
    scan.process.send_signal(signal.SIGCONT)
    scan.wait_until(lambda: not scan.is_stopped)
    assert_rests(scan, firmware, tmp_path)  # a pause by key outlasts Ctrl-Z


def test_a_lost_terminal_ends_the_scan(scan: Terminal, firmware: Firmware) -> None:
    """The window is closed, the link to the computer breaks: laser off, axis closed."""
    scan.wait_until(lambda: firmware.laser_on)
    scan.hang_up()
    scan.process.wait(20)
    assert not firmware.laser_on and firmware.received[-1] == "M5"


def test_after_a_restart_of_the_controller_the_way_on_is_said(
    scan: Terminal, firmware: Firmware, tmp_path: Path
) -> None:
    """Its position is lost: the head has to go back to where the scan began."""
    firmware.restart()
    assert scan.wait_for_end() == 2
    assert f"{stops_done(tmp_path)} of {STOPS} stops are recorded" in scan.screen
    assert "--resume --at-start then continues it" in scan.screen


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_question_can_be_left_at_once(
    camera: tuple[str, ...], tmp_path: Path, number: signal.Signals
) -> None:
    """With a person as the axis: the laser is told off, one line, exit code 2."""
    options = ("--stops", STOPS, "--settle", 0)
    with on_terminal(
        "scan", "-o", tmp_path / "scan", "--axis", "manual", *camera, *options
    ) as terminal:
        for question in ("is now 0 degrees", "to 0 degrees", "laser off", "laser on"):
            terminal.wait_for(question)
            terminal.press("\n")
        terminal.wait_for("Switch the laser off, then press Enter.", times=2)
        os.kill(terminal.process.pid, number)
        assert terminal.wait_for_end() == 2
        said = terminal.screen.replace("\r", "").splitlines()
        assert said[-2:] == [
            "Switch the laser off.",
            "error: cancelled; --resume continues the scan",
        ]
        assert terminal.settings == terminal.settings_before


def test_ctrl_z_at_a_question_has_the_laser_off_meanwhile(
    camera: tuple[str, ...], tmp_path: Path
) -> None:
    """The person is told to switch it off, and on again when the question goes on."""
    options = ("--stops", STOPS, "--settle", 0)
    with on_terminal(
        "scan", "-o", tmp_path / "scan", "--axis", "manual", *camera, *options
    ) as terminal:
        for question in ("is now 0 degrees", "to 0 degrees", "laser off", "laser on"):
            terminal.wait_for(question)
            terminal.press("\n")
        terminal.wait_for("Switch the laser off, then press Enter.", times=2)
        terminal.press("\x1a")
        terminal.wait_for("Switch the laser off.\r\n")
        terminal.wait_until(lambda: terminal.is_stopped)
        terminal.process.send_signal(signal.SIGCONT)
        terminal.wait_for("Switch the laser on again.")
        terminal.press("\n")
        terminal.wait_for("Turn the head to 9 degrees")
        assert stops_done(tmp_path) == 1
