"""The folder in which a batch comes about: its lock, its description and its journal.

- `batch.json`: what is drawn and how to read it, written once, before the first view;
- `views.jsonl`: one line a view that is whole: name, lens, pose, counts;
- `.unfinished`: what is being written; it gets its name when it is whole.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from depthwarp.batch_job.description import differences
from depthwarp.batch_job.lock import locked
from depthwarp.errors import FileFormatError, InputError

__all__ = ["DESCRIPTION", "JOURNAL", "Workplace", "disk_errors", "read_description"]

DESCRIPTION, JOURNAL = "batch.json", "views.jsonl"
LOCK, UNFINISHED = ".lock", ".unfinished"

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
        raise InputError(
            f"cannot write {error.filename or output}: {error.strerror or error}; what is written "
            "stays: make room, and the same command continues"
        ) from error


def read_description(text: str | bytes, path: Path) -> Entry:
    """What a batch says of itself.

    Raises:
        FileFormatError: The text is not such a description.
    """
    try:
        description = json.loads(text)
        if description["format"] != "depthwarp batch":
            raise ValueError("it is of another format")
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise FileFormatError(
            f"{path} does not describe a batch ({error}): choose another output"
        ) from error
    return dict(description)


class Workplace:
    """A folder that holds a batch, or will; while it is entered no other run writes to it.

    Args:
        folder: Made if its parent is there.
        output: What the person calls the output, for messages.
        others: Names of further files that the batch has there for as long as it is unfinished.

    Attributes:
        done: Which views are whole, shape (V,); set by `begin`.
    """

    def __init__(self, folder: Path, output: Path, others: Sequence[str] = ()) -> None:
        self.folder, self.output = folder, output
        self.done: npt.NDArray[np.bool_] = np.zeros(0, np.bool_)
        self._stack = ExitStack()
        self._journal: BinaryIO | None = None
        self._others = tuple(others)
        self._is_ours_to_remove = False

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
        with disk_errors(self.output):
            folder.mkdir(exist_ok=True)
        self._check_nothing_else()
        self._stack.enter_context(locked(folder / LOCK, self.output))
        return self

    def __exit__(self, *exception: object) -> None:
        """Let go of the folder; where no view was ever written, nothing is left behind."""
        if self._journal is not None:
            self._journal.close()
            if not self.done.any():
                self._remove_files()
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
        has_views = journal.exists() and journal.stat().st_size > 0
        if has_views:
            there = read_description(path.read_bytes(), path)
            if different := differences(there, description):
                raise InputError(
                    f"{self.output} was begun with something else: {'; '.join(different)}. Repeat "
                    "that command to continue it, or choose another output"
                )
        with disk_errors(self.output):
            if not has_views:
                self.put(path, (json.dumps(description, indent=2) + "\n").encode())
            self._journal = journal.open("ab")
            self.done = np.zeros(count, np.bool_)
            if sum(map(len, self._good_lines(is_whole))) != journal.stat().st_size:
                self._keep_good_lines(is_whole)

    def put(self, target: Path, content: bytes) -> None:
        """Write a file, which appears whole or not at all.

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

    def remove(self) -> None:
        """The folder has served: remove the batch's files now, and on leaving the folder."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None
        self._remove_files()
        self._is_ours_to_remove = True

    def record(self, entry: Entry) -> None:
        """Count a view as done: to be called when it is whole.

        Raises:
            OSError: The disk is full.
        """
        assert self._journal is not None
        end = os.fstat(self._journal.fileno()).st_size
        try:
            self._journal.write((json.dumps(entry) + "\n").encode())
            self._journal.flush()
        except OSError:
            with suppress(OSError):  # a line that is cut short is passed over anyway
                os.truncate(self._journal.fileno(), end)
            raise
        self.done[entry["view"]] = True

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

    def _keep_good_lines(self, is_whole: Callable[[Entry], bool]) -> None:
        """Write the journal anew, without lines that were cut short and views that are gone."""
        assert self._journal is not None
        self._journal.close()
        unfinished = self.folder / UNFINISHED
        with unfinished.open("wb") as file:
            file.writelines(self._good_lines(is_whole))
        os.replace(unfinished, self.folder / JOURNAL)
        self._journal = (self.folder / JOURNAL).open("ab")

    def _remove_files(self) -> None:
        # The description last: without it the rest would be somebody else's.
        for name in (*self._others, JOURNAL, UNFINISHED, DESCRIPTION):
            (self.folder / name).unlink(missing_ok=True)

    def _check_nothing_else(self) -> None:
        """Refuse a folder that holds something and no batch."""
        if (self.folder / DESCRIPTION).exists():
            return
        with os.scandir(self.folder) as entries:
            others = (entry.name for entry in entries)
            other = next((name for name in others if name not in (LOCK, UNFINISHED)), None)
        if other is not None:
            raise InputError(
                f"cannot write {self.output}: {self.folder} holds other files ({other}); give an "
                "empty or a new folder"
            )
