"""Errors that a caller of depthwarp can meet: each says what was wrong, where, and what to do."""

from __future__ import annotations

__all__ = [
    "CapacityError",
    "DepthwarpError",
    "DeviceError",
    "FileFormatError",
    "InputError",
    "LensDomainWarning",
    "MissingExtraError",
]


class DepthwarpError(Exception):
    """Base of every error that depthwarp raises on purpose."""


class InputError(DepthwarpError, ValueError):
    """An argument cannot be used: the message names it, what was expected, and what was given."""


class FileFormatError(InputError):
    """A file's content is not what its name or its header says."""


class DeviceError(InputError):
    """A compute device was asked for that this machine does not have."""


class CapacityError(InputError, MemoryError):
    """A request would need more memory than there is."""


class MissingExtraError(DepthwarpError, ImportError):
    """An optional package is needed; the message holds the command that installs it."""

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        super().__init__(
            f"{purpose} needs the package '{package}', which is not installed: "
            f'pip install "depthwarp[{extra}]"'
        )


class LensDomainWarning(UserWarning):
    """A lens model reaches less than its image: some pixels will never be drawn."""
