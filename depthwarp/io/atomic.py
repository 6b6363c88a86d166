"""Files that appear whole or not at all, even if the power fails: write beside, sync, rename."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from depthwarp.errors import InputError

__all__ = ["atomic_path", "check_target", "sync"]


def check_target(target: Path) -> None:
    """Refuse a name that cannot be written to.

    Raises:
        InputError: The folder does not exist, or the target is a folder.
    """
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; give a file name")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {target}: folder {target.parent} does not exist; create it")


def sync(path: Path) -> None:
    """Wait until a file's content, or the names in a folder, are on the disk.

    Raises:
        OSError: The disk is full or fails, or there is no such path.
    """
    is_folder = path.is_dir()
    if is_folder and os.name == "nt":
        return  # Windows opens no folder; NTFS has a journal for names
    handle = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some network file systems sync files and know no such thing for folders.
        if not (is_folder and error.errno == errno.EINVAL):
            raise
    finally:
        os.close(handle)


@contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary name beside `target`, renamed to it when the block ends without an error.

    The temporary name keeps the suffix, so writers that choose the format by suffix work. When
    the block raises, the temporary file is removed and an older `target` is left as it was. Its
    content is on the disk before it has its name: a power cut leaves the older or the new file.

    Raises:
        InputError: The folder does not exist or cannot be written, the target is a folder, or the
            block met an error of the file system such as a full disk.
    """
    target = Path(target)
    check_target(target)
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        with temporary.open("wb"):
            pass
    except OSError as error:
        raise InputError(
            f"cannot write {target}: {error.strerror}; choose another folder"
        ) from error
    try:
        yield temporary
        sync(temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(
            f"cannot write {target}: {error.strerror or error}; make room or choose another folder"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
