"""All views of a batch in one NPZ: put together from arrays on the disk, never in memory."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from io import FileIO
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from depthwarp.batch_job.stacked import ARRAYS, PIXEL_BYTES, Stacked, count_names
from depthwarp.batch_job.views import Views
from depthwarp.batch_job.workplace import Entry, disk_errors, write_all
from depthwarp.depth_map import DepthMap
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import sync

__all__ = ["MOST_BYTES", "NpzFile"]

MOST_BYTES = 1 << 35
"""Largest size of the arrays: who reads an NPZ has each array in memory as a whole."""

COPY_BYTES = 1 << 22
ABOUT = "about"
WHOLE = "whole.npz"


class NpzFile(Stacked):
    """One NPZ with the arrays of `Stacked`; an array a file until it is put together.

    Args:
        path: The file.
        views: The views, all of one size.

    Raises:
        InputError: Views of several sizes, or more pixels than `MOST_BYTES` hold.
    """

    def __init__(self, path: Path, views: Views) -> None:
        super().__init__(path, views, [WHOLE, *(f"{name}.npy" for name in ARRAYS)])
        count, height, width = self.shape
        self._bytes = PIXEL_BYTES * count * height * width
        if self._bytes > MOST_BYTES:
            raise InputError(
                f"cannot write {path}: {count} views of {width} x {height} px are "
                f"{_size(self._bytes)}, more than the {_size(MOST_BYTES)} that one NPZ may "
                "have; give a folder, or a .zarr, in its place"
            )
        # Without buffers: what a full disk did not take is not tried again when they are closed.
        self._files: dict[str, FileIO] = {}

    def __enter__(self) -> NpzFile:
        """Lock the file; see `Output.__enter__`."""
        if self.path.is_dir():
            raise InputError(f"cannot write {self.path}: it is a folder; give a file name")
        super().__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        """Let go of the file; what is written stays."""
        for file in self._files.values():
            file.close()
        super().__exit__(*exception)

    def _begin_arrays(self) -> None:
        are_whole = all(self._is_array(name) for name in ARRAYS)
        self.work.begin(self.description, len(self.views), lambda entry: are_whole)
        with disk_errors(self.path):
            for name in ARRAYS:
                path = self.work.folder / f"{name}.npy"
                if not are_whole:
                    self._make_array(name, path)
                self._files[name] = FileIO(path, "r+b")

    def _put_all(self, numbers: Sequence[int], maps: Sequence[DepthMap]) -> Iterator[Entry]:
        for number, depth_map in zip(numbers, maps, strict=True):
            for name, file in self._files.items():
                values = np.ascontiguousarray(getattr(depth_map, name))
                # From the end: the header's length is a matter of the format.
                file.seek(-values.nbytes * (len(self.views) - int(number)), os.SEEK_END)
                write_all(file, values.data.cast("B"))
            yield {}

    def _made_of(self, entries: Sequence[Entry]) -> Iterable[Path]:
        return [self.work.folder / f"{name}.npy" for name in ARRAYS]

    def _about(self) -> str:
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(f"{ABOUT}.npy") as member:
                return str(npy.read_array(member, allow_pickle=False))
        except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
            raise FileFormatError(
                f"cannot write {self.path}: it is there and not a batch; choose another name"
            ) from error

    def _size_of(self, name: str) -> int:
        """Bytes of an array without its header."""
        count, height, width = self.shape
        return int(np.dtype(ARRAYS[name]).itemsize) * count * height * width

    def _is_array(self, name: str) -> bool:
        """Whether an array's file is there, header and all."""
        try:
            with (self.work.folder / f"{name}.npy").open("rb") as file:
                npy.read_magic(file)
                shape, _, dtype = npy.read_array_header_1_0(file)
                begin, end = file.tell(), file.seek(0, os.SEEK_END)
        except (OSError, ValueError):
            return False
        return (shape, dtype, end - begin) == (self.shape, ARRAYS[name], self._size_of(name))

    def _make_array(self, name: str, path: Path) -> None:
        """An array of zeros, which takes room as it is filled."""
        free = shutil.disk_usage(self.work.folder).free
        if 2 * self._bytes > free:
            raise InputError(
                f"cannot write {self.path}: it will be {_size(self._bytes)} and takes twice that "
                f"while it is made, {_size(free)} are free; make room, or give a folder"
            )
        header = {"descr": npy.dtype_to_descr(np.dtype(ARRAYS[name])), "fortran_order": False}
        with path.open("wb") as file:
            npy.write_array_header_1_0(file, header | {"shape": self.shape})
            file.truncate(file.tell() + self._size_of(name))

    def _put_together(self) -> None:
        whole = self.work.folder / WHOLE
        try:
            with zipfile.ZipFile(whole, "w") as archive:
                for name in ARRAYS:
                    info = zipfile.ZipInfo(f"{name}.npy")  # its time is the same in all files
                    with (
                        (self.work.folder / info.filename).open("rb") as file,
                        archive.open(info, "w", force_zip64=True) as member,
                    ):
                        shutil.copyfileobj(file, member, COPY_BYTES)
                known = self._known_of_views() | {
                    "count_names": np.array(count_names()),
                    "names": np.array(list(self.views.names)),
                    ABOUT: np.array(json.dumps(self.description)),
                }
                for name, values in known.items():
                    info = zipfile.ZipInfo(f"{name}.npy")
                    with archive.open(info, "w", force_zip64=True) as member:
                        npy.write_array(member, values, allow_pickle=False)
            sync(whole)
            os.replace(whole, self.path)
        except BaseException:
            whole.unlink(missing_ok=True)
            raise


def _size(count: int) -> str:
    """A number of bytes, as a person reads it."""
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
