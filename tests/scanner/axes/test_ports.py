"""Ports by their USB serial number."""

from __future__ import annotations

from contextlib import closing
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from depthwarp.errors import InputError
from depthwarp.scanner.axes.ports import describe_ports, find_port
from depthwarp.scanner.axes.serial_line import SerialLine
from depthwarp.scanner.twin.pseudo_terminal import PseudoTerminal


def plug(monkeypatch: pytest.MonkeyPatch, **ports: str | None) -> None:
    """Plug devices in, each with its serial number or none."""
    there = [
        SimpleNamespace(device=device, description="CH340", serial_number=number)
        for device, number in ports.items()
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: there)


def test_a_number_finds_its_device_wherever_it_is_plugged_in(monkeypatch: pytest.MonkeyPatch):
    """After a replug the same number leads to the new device name."""
    plug(monkeypatch, ttyUSB0="A1", ttyUSB1=None)
    assert find_port("serial:A1") == "ttyUSB0"
    plug(monkeypatch, ttyUSB0=None, ttyUSB3="A1")
    assert find_port("serial:A1") == "ttyUSB3"


def test_other_names_are_left_alone(monkeypatch: pytest.MonkeyPatch):
    """A device or a URL is not looked up."""
    plug(monkeypatch)
    assert find_port("/dev/ttyUSB0") == "/dev/ttyUSB0"
    assert find_port("socket://host:23") == "socket://host:23"


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ("serial:B2", r"'B2'.*plug.*ttyUSB0 \(CH340\), serial:A1"),
        ("serial:", "no port has"),
        ("serial:C3", "several.*ttyUSB1, ttyUSB2.*instead"),
    ],
)
def test_none_and_several_are_refused(
    monkeypatch: pytest.MonkeyPatch, port: str, message: str
) -> None:
    """The message names the numbers that are there."""
    plug(monkeypatch, ttyUSB0="A1", ttyUSB1="C3", ttyUSB2="C3", ttyUSB4=None)
    assert "ttyUSB4 (CH340)" in describe_ports()
    with pytest.raises(InputError, match=message):
        find_port(port)


def test_a_line_looks_the_number_up_at_each_opening(monkeypatch: pytest.MonkeyPatch):
    """One line, opened again after a replug, reaches the device where it is by then."""
    line = SerialLine("serial:A1", 115200, lambda text: None)
    plug(monkeypatch)
    with pytest.raises(InputError, match="plug the controller in"):
        line.open()
    with closing(PseudoTerminal()) as far:
        plug(monkeypatch, **{far.path: "A1"})
        line.open()
        with closing(line):
            assert not line.is_lost


def test_ports_without_a_device_are_not_named(monkeypatch: pytest.MonkeyPatch):
    """A mainboard's port of which nothing is known is none that a controller is plugged into."""
    empty = SimpleNamespace(device="/dev/ttyS0", description="n/a", serial_number=None)
    monkeypatch.setattr(list_ports, "comports", lambda: [empty])
    assert describe_ports() == "no serial device is plugged in"
    known = SimpleNamespace(device="/dev/ttyUSB0", description="CH340", serial_number="A1")
    monkeypatch.setattr(list_ports, "comports", lambda: [empty, known])
    assert describe_ports() == (
        "serial devices that are plugged in: /dev/ttyUSB0 (CH340), serial:A1"
    )
