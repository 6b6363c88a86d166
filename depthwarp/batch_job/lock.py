"""One run at a time writes an output: a lock that ends with its process, however that ends."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from depthwarp.errors import InputError

__all__ = ["FULL", "cannot_begin", "locked"]

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that more room puts right."""


def cannot_begin(output: Path, error: OSError) -> InputError:
    """What to say where not even the first file can be made."""
    remedy = (
        "make room or choose another folder" if error.errno in FULL else "choose another folder"
    )
    return InputError(f"cannot write {output}: {error.strerror}; {remedy}")


@contextmanager
def locked(path: Path, output: Path) -> Iterator[None]:
    """Hold a lock on a file, made for that, for as long as the block lasts.

    The system's own lock, which a killed process cannot leave behind; the file may stay, and says
    nothing.

    Args:
        path: The file.
        output: What it guards, for the message.

    Raises:
        InputError: Another process holds it, or the file cannot be made.
    """
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise cannot_begin(output, error) from error
    try:
        if not _take(handle) or not _is_still(handle, path):
            raise InputError(
                f"{output} is being written by another run: wait until that has ended, or choose "
                "another output"
            )
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes no file that is open
                path.unlink(missing_ok=True)
    finally:
        os.close(handle)


def _take(handle: int) -> bool:
    """Whether the lock is ours now."""
    try:
        try:
            import fcntl
        except ImportError:  # Windows
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        else:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_still(handle: int, path: Path) -> bool:
    """Whether the file has not been removed, by the run that held it, since it was opened."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except OSError:
        return False
