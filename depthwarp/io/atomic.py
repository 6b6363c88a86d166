"""Files that appear whole or not at all: write beside the target, then rename."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from depthwarp.errors import InputError

__all__ = ["atomic_path", "check_target"]


def check_target(target: Path) -> None:
    """Refuse a name that cannot be written to.

    Raises:
        InputError: The folder does not exist, or the target is a folder.
    """
    if target.is_dir():
        raise InputError(f"cannot write {target}: it is a folder; give a file name")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {target}: folder {target.parent} does not exist; create it")


@contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary name beside `target`, renamed to it when the block ends without an error.

    The temporary name keeps the suffix, so writers that choose the format by suffix work. When
    the block raises, the temporary file is removed and an older `target` is left as it was.

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
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(
            f"cannot write {target}: {error.strerror or error}; make room or choose another folder"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
