"""Serial ports of this machine: which there are, and the one with a USB serial number."""

from __future__ import annotations

from serial.tools import list_ports

from depthwarp.errors import InputError

__all__ = ["describe_ports", "find_port"]

_BY_NUMBER = "serial:"

_NOTHING_KNOWN = "n/a"  # what pyserial says of a mainboard's port, wired to a socket or not


def describe_ports() -> str:
    """Say in one sentence behind which serial ports of this machine there is a device."""
    ports = [
        f"{port.device} ({port.description})"
        + (f", {_BY_NUMBER}{port.serial_number}" if port.serial_number else "")
        for port in list_ports.comports()
        if port.description != _NOTHING_KNOWN
    ]
    if not ports:
        return "no serial device is plugged in"
    return f"serial devices that are plugged in: {'; '.join(ports)}"


def find_port(port: str) -> str:
    """The device behind a port's name, looked up now.

    A plugged-in USB device may get another device name each time; its serial number stays.

    Args:
        port: `serial:NUMBER` with a USB serial number; anything else is returned as it is.

    Raises:
        InputError: No port has that serial number, or several do.
    """
    if not port.startswith(_BY_NUMBER):
        return port
    number = port.removeprefix(_BY_NUMBER)
    found = [one.device for one in list_ports.comports() if number and one.serial_number == number]
    if len(found) == 1:
        return str(found[0])
    if found:
        raise InputError(
            f"several ports have the USB serial number {number!r}: {', '.join(found)}; "
            "name one of these devices instead"
        )
    raise InputError(
        f"no port has the USB serial number {number!r}: plug the controller in; {describe_ports()}"
    )
