"""Files that appear whole: what is on the disk when they get their name."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from depthwarp.io import atomic
from depthwarp.io.atomic import atomic_path, sync


def test_the_content_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    """A power cut after the renaming finds the new file, not an empty one."""
    target, steps = tmp_path / "map.png", list[str]()
    fsync, replace = os.fsync, os.replace

    def noting_fsync(handle: int) -> None:
        fsync(handle)
        steps.append(f"synced {os.fstat(handle).st_size} bytes")

    def noting_replace(one: Path, other: Path) -> None:
        replace(one, other)
        steps.append("named")

    monkeypatch.setattr(os, "fsync", noting_fsync)
    monkeypatch.setattr(os, "replace", noting_replace)
    with atomic_path(target) as temporary:
        temporary.write_bytes(b"0123456789")
    assert steps == ["synced 10 bytes", "named"]


def test_a_disk_that_fails_leaves_the_older_file(tmp_path, monkeypatch):
    """What cannot be brought to the disk does not replace what is there."""
    target = tmp_path / "map.png"
    target.write_bytes(b"older")

    def broken(handle: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises(ValueError, match="cannot write .*map.png: Input/output error"):
        with atomic_path(target) as temporary:
            temporary.write_bytes(b"newer")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"older"]


def test_folders_that_cannot_be_synced_are_passed_over(tmp_path, monkeypatch):
    """Some network file systems refuse to sync a folder; a file's refusal is an error."""
    (tmp_path / "file").write_bytes(b"")

    def refuse(handle: int) -> None:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(atomic.os, "fsync", refuse)
    sync(tmp_path)
    with pytest.raises(OSError, match="Invalid argument"):
        sync(tmp_path / "file")
