"""Links: what can be opened, what cannot and why, and how a stream becomes answers and pushes."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from serial.tools import list_ports

from depthwarp.errors import InputError
from depthwarp.scanner.axes import GrblAxis
from depthwarp.scanner.axes.serial_line import SerialLine
from depthwarp.scanner.axis import AxisError, AxisLostError, AxisTimeoutError
from depthwarp.scanner.twin.pseudo_terminal import PseudoTerminal
from tests.scanner.axes.conftest import PATIENCE_S, SHORT_S, MakeRig, build_axis, wait_until


@contextmanager
def open_line(port: str) -> Iterator[tuple[SerialLine, list[str]]]:
    pushed: list[str] = []
    line = SerialLine(port, 115200, pushed.append)
    line.open()
    with closing(line):
        yield line, pushed


@contextmanager
def far_end() -> Iterator[PseudoTerminal]:
    with closing(PseudoTerminal()) as terminal:
        yield terminal


@contextmanager
def in_background(work: threading.Thread) -> Iterator[None]:
    work.start()
    yield
    work.join()


def test_answers_and_pushes_are_told_apart() -> None:
    """Pushes before the answer do not count as one; an error comes back as such."""
    with far_end() as far, open_line(far.path) as (line, pushed):

        def answer() -> None:
            assert far.read(5.0) == b"G1 X1\n"
            far.write(b"<Run|MPos:0.000>\r\n[MSG:hello]\r\nok\r\n")
            assert far.read(5.0) == b"G99\n"
            far.write(b"error:20\r\nALARM:1\r\nGrbl 1.1h ['$' for help]\r\n")

        with in_background(threading.Thread(target=answer)):
            line.command("G1 X1", 5.0, line.draw_ticket())
            with pytest.raises(AxisError, match="'G99': error:20"):
                line.command("G99", 5.0, line.draw_ticket())
        wait_until(lambda: len(pushed) == 4)
        assert pushed == [
            "<Run|MPos:0.000>",
            "[MSG:hello]",
            "ALARM:1",
            "Grbl 1.1h ['$' for help]",
        ]


def test_a_void_ticket_writes_nothing() -> None:
    """After an interruption a late command never reaches the controller."""
    with far_end() as far, open_line(far.path) as (line, _):
        ticket = line.draw_ticket()
        line.interrupt(AxisError("stopped"))
        line.interrupt(AxisError("which led to an alarm"))
        with pytest.raises(AxisError, match="stopped"):
            line.command("G1 X1", 1.0, ticket)
        assert far.read(0.05) == b""


def test_an_answer_that_does_not_come_is_a_timeout() -> None:
    """The message names the command and what was heard last, printable."""
    with far_end() as far, open_line(far.path) as (line, _):
        far.write(b"\xff\x07zzz\r\n")
        wait_until(lambda: line.heard)
        with pytest.raises(
            AxisTimeoutError, match=r"'G1 X1' within 0\.1 s; it said last: "
        ) as info:
            line.command("G1 X1", 0.1, line.draw_ticket())
        assert str(info.value).isprintable()


def test_a_line_without_end_does_not_fill_the_memory() -> None:
    """A stream with no line ends is cut into pieces."""
    with far_end() as far, open_line(far.path) as (line, pushed):
        for _ in range(10):
            far.write(b"x" * 1000)
            time.sleep(0.005)
        wait_until(lambda: pushed)
        assert max(map(len, pushed)) < 6000
        assert not line.is_lost


def test_unplugging_is_a_lost_link() -> None:
    """A command that waits fails at once when the line goes, and every later one."""
    with far_end() as far, open_line(far.path) as (line, _):
        with (
            in_background(threading.Timer(0.1, far.drop)),
            pytest.raises(AxisLostError, match="plug"),
        ):
            line.command("G1 X1", 5.0, line.draw_ticket())
        with pytest.raises(AxisLostError):
            line.write(b"?")
        assert line.is_lost


def test_a_port_that_is_not_there_lists_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message helps to find the right name."""
    port = SimpleNamespace(
        device="/dev/ttyUSB7", description="CP2102 USB to UART", serial_number=None
    )
    monkeypatch.setattr(list_ports, "comports", lambda: [port])
    with pytest.raises(InputError, match=r"'/dev/none'.*ttyUSB7 \(CP2102"):
        GrblAxis("/dev/none").connect()
    monkeypatch.setattr(list_ports, "comports", list)
    with pytest.raises(InputError, match="no serial port '/dev/none'.*no serial device is plugged"):
        GrblAxis("/dev/none").connect()


def test_what_is_no_serial_port_is_refused(tmp_path: Path) -> None:
    """A file, a folder, an unknown kind of address, a dead server."""
    file = tmp_path / "file"
    file.touch()
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        dead = server.getsockname()[1]
    for place in (file, tmp_path):
        with pytest.raises(InputError, match=f"'{place}' does not open as a serial port"):
            GrblAxis(str(place)).connect()
    for port in ("warp://9", f"socket://127.0.0.1:{dead}", "socket://x"):
        with pytest.raises(InputError, match="port"):
            GrblAxis(port).connect()


def test_a_port_in_use_says_so(make_rig: MakeRig) -> None:
    """The second axis on a port is turned away, the first goes on."""
    rig = make_rig()
    with rig.axis:
        with pytest.raises(AxisError, match="in use"):
            build_axis("grbl", rig.firmware.path).connect()
        rig.axis.reference()
        assert rig.axis.move_to(9.0) == 9.0


def test_a_port_without_permission_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message names the group."""

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    with pytest.raises(AxisError, match="dialout"):
        GrblAxis("/dev/ttyUSB0").connect()


def test_a_spy_url_writes_a_log(make_rig: MakeRig, tmp_path: Path) -> None:
    """The log for a bug report holds both directions."""
    rig = make_rig()
    log = tmp_path / "wire.txt"
    with build_axis("grbl", f"spy://{rig.firmware.path}?file={log}") as axis:
        axis.reference()
    text = log.read_text()
    assert "TX" in text
    assert "RX" in text
    assert "G10 L20" in text


class TcpBridge:
    """A serial device server: one client, its bytes to a pseudo terminal and back."""

    def __init__(self, path: str) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._device = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self._client: socket.socket | None = None
        self._threads = [threading.Thread(target=self._serve)]
        self._threads[0].start()

    def _serve(self) -> None:
        with suppress(OSError):
            self._client, _ = self._server.accept()
            back = threading.Thread(target=self._send_back, args=(self._client,))
            self._threads.append(back)
            back.start()
            while data := self._client.recv(1024):
                os.write(self._device, data)
        os.write(self._device, b"?")  # its answer wakes the thread that reads

    def _send_back(self, client: socket.socket) -> None:
        with suppress(OSError):
            while data := os.read(self._device, 1024):
                client.sendall(data)

    def hang_up(self) -> None:
        if self._client is not None:
            self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        with suppress(OSError):
            self.hang_up()
        for thread in self._threads:
            thread.join()
        if self._client is not None:
            self._client.close()
        self._server.close()
        os.close(self._device)


def test_an_axis_behind_a_socket(make_rig: MakeRig) -> None:
    """`socket://` works like a device name, and a server that hangs up is a lost link."""
    rig = make_rig()
    with closing(TcpBridge(rig.firmware.path)) as bridge:
        with build_axis("grbl", bridge.url) as axis:
            axis.reference()
            assert axis.move_to(45.0) == 45.0 == rig.firmware.true_angle
            bridge.hang_up()
            with pytest.raises(AxisLostError):
                axis.move_to(90.0)


def test_nothing_is_left_open_by_a_failed_connection(make_rig: MakeRig) -> None:
    """After silence the port can be opened again at once."""
    rig = make_rig(patience_s=SHORT_S)
    rig.firmware.silent = True
    with pytest.raises(AxisTimeoutError, match="nothing answers"):
        rig.axis.connect()
    rig.firmware.silent = False
    rig.axis.patience_s = PATIENCE_S
    assert rig.axis.connect() == "Grbl 1.1h ['$' for help]"
