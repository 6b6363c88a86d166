"""The folder in which a batch comes about: its lock, its description and its journal.

- `batch.json`: what is drawn and how to read it, written once, before the first view;
- `views.jsonl`: one line a view that is whole: name, lens, pose, counts; in the order of the
  views when all of them are there;
- `.unfinished`: what is being written; it gets its name when it is whole.

A line of the journal is written when its view's files are on the disk, not only in the system's
memory: what it says is true after a power cut too. The disk is waited for once a tile of views.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.batch_job.description import differences, read_description
from depthwarp.batch_job.journal import is_in_order, lines_in_order
from depthwarp.batch_job.lock import FULL, cannot_begin, locked
from depthwarp.errors import InputError
from depthwarp.io.atomic import sync

__all__ = [
    "DESCRIPTION",
    "JOURNAL",
    "Workplace",
    "disk_errors",
    "write_all",
]

DESCRIPTION, JOURNAL = "batch.json", "views.jsonl"
LOCK, UNFINISHED = ".lock", ".unfinished"

SYNCING_THREADS = 8
"""Files that are waited for at once; file systems write what comes together in one go."""

Entry = dict[str, Any]


@contextmanager
def disk_errors(output: Path) -> Iterator[None]:
    """Say what a full disk, or a folder that cannot be written, means for a batch.

    Raises:
        InputError: In place of an OSError.
    """
    try:
        yield
    except OSError as error:
        remedy = "make room" if error.errno in FULL else "let files be written there"
        raise InputError(
            f"cannot write {error.filename or output}: {error.strerror or error}; what is written "
            f"stays: {remedy}, and the same command continues"
        ) from error


def write_all(file: FileIO, content: bytes | memoryview) -> None:
    """Write to a file without a buffer, which may take less than it is given.

    Raises:
        OSError: The disk is full.
    """
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]


class Workplace:
    """A folder that holds a batch, or will; while it is entered no other run writes to it.

    Args:
        folder: Made if its parent is there.
        output: What the person calls the output, for messages.
        others: Names of further files and folders that the batch has there for as long as it is
            unfinished.

    Attributes:
        done: Which views are whole, shape (V,); set by `begin`.
    """

    def __init__(self, folder: Path, output: Path, others: Sequence[str] = ()) -> None:
        self.folder, self.output = folder, output
        self.done: npt.NDArray[np.bool_] = np.zeros(0, np.bool_)
        self._stack = ExitStack()
        # Without a buffer: what a full disk did not take is not tried again when it is closed.
        self._journal: FileIO | None = None
        self._pool = ThreadPoolExecutor(SYNCING_THREADS)
        self._syncing: list[Future[None]] = []
        self._others = tuple(others)
        self._is_ours_to_remove = self._is_new = False

    def __enter__(self) -> Workplace:
        """Make the folder and lock it.

        Raises:
            InputError: It cannot be made, holds something else, or another run writes to it.
        """
        folder = self.folder
        if not folder.parent.is_dir():
            raise InputError(
                f"cannot write {self.output}: folder {folder.parent} does not exist; create it"
            )
        if folder.exists() and not folder.is_dir():
            raise InputError(f"cannot write {self.output}: {folder} is a file; choose another name")
        self._is_ours_to_remove = not folder.exists()
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise cannot_begin(self.output, error) from error
        try:
            self._stack.enter_context(locked(folder / LOCK, self.output))
            self._check_nothing_else()  # now: before, another run may just have begun
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        """Let go of the folder; where no view was ever written, nothing is left behind."""
        self._pool.shutdown(cancel_futures=True)
        try:
            if self._journal is not None:
                self._journal.close()
            if self._is_new and not self.done.any() and self._stranger() is None:
                self._remove_files()
        finally:
            self._stack.close()
            if self._is_ours_to_remove:
                with suppress(OSError):  # it is not empty, or gone
                    self.folder.rmdir()

    def begin(self, description: Entry, count: int, is_whole: Callable[[Entry], bool]) -> None:
        """Begin the batch, or go on with it.

        Args:
            description: All that decides what the files hold, as JSON values.
            count: Number of views.
            is_whole: Whether what a line of the journal says is in its place.

        Raises:
            InputError: The folder was begun with another description; the message says what
                differs. Or it cannot be written.
            FileFormatError: The description in the folder is none.
        """
        path, journal = self.folder / DESCRIPTION, self.folder / JOURNAL
        has_lines = journal.exists() and journal.stat().st_size > 0
        # A kill in the first tile leaves files of views, and no line yet.
        self._is_new = not has_lines and self._stranger() is None
        if not self._is_new:
            there = read_description(path.read_bytes(), path)
            if different := differences(there, description):
                raise InputError(
                    f"{self.output} was begun with something else: {'; '.join(different)}. Repeat "
                    "that command to continue it, or choose another output"
                )
        with disk_errors(self.output):
            if self._is_new:
                self.put(path, (json.dumps(description, indent=2) + "\n").encode())
                sync(self.folder.parent)  # the folder's own name
            self._journal = FileIO(journal, "ab")
            self.done = np.zeros(count, np.bool_)
            if sum(map(len, self._good_lines(is_whole))) != journal.stat().st_size:
                # Without lines that were cut short, and views that are gone.
                self._write_journal(self._good_lines(is_whole))

    def put(self, target: Path, content: bytes) -> None:
        """Write a file, which appears whole or not at all; `record` waits until it is on the disk.

        Raises:
            OSError: The disk is full, or the folder cannot be written.
        """
        unfinished = self.folder / UNFINISHED
        try:
            unfinished.write_bytes(content)
            os.replace(unfinished, target)
        except OSError:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise
        self._syncing.append(self._pool.submit(sync, target))

    def remove(self) -> None:
        """The folder has served: remove the batch's files now, and on leaving the folder."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None
        self._remove_files()
        self._is_ours_to_remove = True

    def record(self, entries: Sequence[Entry], made: Iterable[Path]) -> None:
        """Count views as done, as soon as all that they are made of is on the disk.

        Args:
            entries: Of the views.
            made: Files that `put` has not written, and folders that hold files beside the
                batch's own.

        Raises:
            OSError: The disk is full; none of them counts.
        """
        assert self._journal is not None
        if not entries:
            return
        syncing, self._syncing = self._syncing, []
        for waited in [*syncing, *(self._pool.submit(sync, path) for path in made)]:
            waited.result()
        sync(self.folder)
        end = os.fstat(self._journal.fileno()).st_size
        try:
            write_all(self._journal, b"".join(json.dumps(e).encode() + b"\n" for e in entries))
            os.fsync(self._journal.fileno())
        except OSError:
            with suppress(OSError):  # a line that is cut short is passed over anyway
                os.ftruncate(self._journal.fileno(), end)
            raise
        self.done[[entry["view"] for entry in entries]] = True

    def put_in_order(self) -> None:
        """Let the journal's lines stand in the order of the views, as if nothing had ended it.

        Raises:
            OSError: The disk is full; the journal is as it was.
        """
        journal = self.folder / JOURNAL
        if not is_in_order(journal):
            self._write_journal(lines_in_order(journal))

    def entries(self) -> Iterator[Entry]:
        """What the journal says of each view that is done, in the order of their writing."""
        with (self.folder / JOURNAL).open("rb") as lines:
            yield from map(json.loads, lines)

    def _good_lines(self, is_whole: Callable[[Entry], bool]) -> Iterator[bytes]:
        """Lines of views that are done, each once; fills `done`."""
        self.done[:] = False
        with (self.folder / JOURNAL).open("rb") as lines:
            for line in lines:
                try:
                    entry = json.loads(line)
                    number = entry["view"]
                    is_good = not self.done[number] and is_whole(entry)
                except (ValueError, KeyError, TypeError, IndexError):
                    return  # a kill cut it short
                if not line.endswith(b"\n"):
                    return
                if is_good:
                    self.done[number] = True
                    yield line

    def _write_journal(self, lines: Iterable[bytes]) -> None:
        """Write the journal anew; it is the old one until the new one is on the disk."""
        assert self._journal is not None
        self._journal.close()
        unfinished, journal = self.folder / UNFINISHED, self.folder / JOURNAL
        try:
            with unfinished.open("wb") as file:
                file.writelines(lines)
            sync(unfinished)
            os.replace(unfinished, journal)
        except OSError:
            with suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise
        sync(self.folder)
        self._journal = FileIO(journal, "ab")

    def _remove_files(self) -> None:
        # The description last: without it the rest would be somebody else's.
        for name in (*self._others, JOURNAL, UNFINISHED, DESCRIPTION):
            path = self.folder / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def _check_nothing_else(self) -> None:
        """Refuse a folder that holds something and no batch."""
        stranger = self._stranger()
        if stranger is not None and not (self.folder / DESCRIPTION).exists():
            raise InputError(
                f"cannot write {self.output}: {self.folder} holds other files ({stranger}); give "
                "an empty or a new folder"
            )

    def _stranger(self) -> str | None:
        """Name of something in the folder beside what every batch has there; a view, or foreign."""
        own = {DESCRIPTION, JOURNAL, LOCK, UNFINISHED, *self._others}
        with os.scandir(self.folder) as entries:
            return next((entry.name for entry in entries if entry.name not in own), None)
