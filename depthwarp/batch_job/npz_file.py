"""All views of a batch in one NPZ: put together from arrays on the disk, never in memory."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from depthwarp.batch_job.description import differences
from depthwarp.batch_job.outputs import Output
from depthwarp.batch_job.views import Views
from depthwarp.batch_job.workplace import Entry, disk_errors, read_description
from depthwarp.depth_map import DepthMap, RenderStats
from depthwarp.errors import FileFormatError, InputError

__all__ = ["MOST_BYTES", "NpzFile"]

MOST_BYTES = 1 << 35
"""Largest size of the arrays: who reads an NPZ has each array in memory as a whole."""

ARRAYS: dict[str, Any] = {"depth": np.float32, "index": np.int32, "state": np.uint8}
"""The arrays with a value a pixel."""

PIXEL_BYTES = sum(np.dtype(dtype).itemsize for dtype in ARRAYS.values())
COPY_BYTES = 1 << 22
ABOUT = "about"
WHOLE = "whole.npz"


class NpzFile(Output):
    """One NPZ with `depth`, `index` and `state` (V, H, W), and what is known of each view.

    Until all views are drawn there is a folder beside it, its name with `.part` added, that holds
    the arrays one by one; the NPZ appears when it is whole.

    Args:
        path: The file.
        views: The views, all of one size.

    Raises:
        InputError: Views of several sizes, or more pixels than `MOST_BYTES` hold.
    """

    def __init__(self, path: Path, views: Views) -> None:
        others = [WHOLE, *(f"{name}.npy" for name in ARRAYS)]
        super().__init__(path, path.with_name(path.name + ".part"), views, others)
        sizes = sorted({lens.size for lens in views.lenses})
        if len(sizes) > 1:
            raise InputError(
                f"cannot write {path}: views of {len(sizes)} sizes do not stack into arrays; give "
                "a folder in its place"
            )
        width, height = sizes[0]
        self._shape = len(views), height, width
        self._bytes = PIXEL_BYTES * len(views) * height * width
        if self._bytes > MOST_BYTES:
            raise InputError(
                f"cannot write {path}: {len(views)} views of {width} x {height} px are "
                f"{self._bytes / 1e9:.3g} GB, more than the {MOST_BYTES / 1e9:.3g} GB that one NPZ "
                "may have; give a folder in its place"
            )
        self._files: dict[str, BinaryIO] = {}

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

    def begin(self, description: Entry) -> None:
        """Begin the batch, or go on with it; see `Output.begin`."""
        self._description = description
        if self.path.exists():
            self._check_same(description)
            self.work.done = np.ones(len(self.views), np.bool_)
            return
        are_whole = all(self._is_array(name) for name in ARRAYS)
        self.work.begin(description, len(self.views), lambda entry: are_whole)
        with disk_errors(self.path):
            for name in ARRAYS:
                path = self.work.folder / f"{name}.npy"
                if not are_whole:
                    self._make_array(name, path)
                self._files[name] = path.open("r+b")

    def finish(self) -> None:
        """Put the file together, and remove the folder of its parts."""
        if not self.path.exists():
            for file in self._files.values():
                file.close()
            with disk_errors(self.path):
                self._put_together()
        self.work.remove()

    def _put_all(self, numbers: Sequence[int], maps: Sequence[DepthMap]) -> Any:
        for number, depth_map in zip(numbers, maps, strict=True):
            for name, file in self._files.items():
                values = np.ascontiguousarray(getattr(depth_map, name))
                # From the end: the header's length is a matter of the format.
                file.seek(-values.nbytes * (len(self.views) - int(number)), os.SEEK_END)
                file.write(values.data)
                file.flush()
            yield {}

    def _check_same(self, description: Entry) -> None:
        """Refuse a file that this batch did not write."""
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(f"{ABOUT}.npy") as member:
                text = str(npy.read_array(member, allow_pickle=False))
        except (zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
            raise FileFormatError(
                f"cannot write {self.path}: it is there and not a batch; choose another name"
            ) from error
        if different := differences(read_description(text, self.path), description):
            raise InputError(
                f"{self.path} was made with something else: {'; '.join(different)}. Choose another "
                "output"
            )

    def _size_of(self, name: str) -> int:
        """Bytes of an array without its header."""
        count, height, width = self._shape
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
        return (shape, dtype, end - begin) == (self._shape, ARRAYS[name], self._size_of(name))

    def _make_array(self, name: str, path: Path) -> None:
        """An array of zeros, which takes room as it is filled."""
        free = shutil.disk_usage(self.work.folder).free
        if 2 * self._bytes > free:
            raise InputError(
                f"cannot write {self.path}: it will be {self._bytes / 1e9:.3g} GB and takes twice "
                f"that while it is made, {free / 1e9:.3g} GB are free; make room, or give a folder"
            )
        header = {"descr": npy.dtype_to_descr(np.dtype(ARRAYS[name])), "fortran_order": False}
        with path.open("wb") as file:
            npy.write_array_header_1_0(file, header | {"shape": self._shape})
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
                for name, values in self._known_of_views().items():
                    info = zipfile.ZipInfo(f"{name}.npy")
                    with archive.open(info, "w", force_zip64=True) as member:
                        npy.write_array(member, values, allow_pickle=False)
            os.replace(whole, self.path)
        except BaseException:
            whole.unlink(missing_ok=True)
            raise

    def _known_of_views(self) -> dict[str, npt.NDArray[Any]]:
        """What the journal says of the views, as arrays, and the description."""
        names = list(RenderStats.__dataclass_fields__)
        count = len(self.views)
        known: dict[str, npt.NDArray[Any]] = {
            "optical_from_world": np.zeros((count, 4, 4)),
            "lens": self.views.lens_of,
            "counts": np.zeros((count, len(names)), np.int64),
            "count_names": np.array(names),
            "names": np.array(list(self.views.names)),
        }
        for entry in self.work.entries():
            known["optical_from_world"][entry["view"]] = entry["optical_from_world"]
            known["counts"][entry["view"]] = [entry["counts"][name] for name in names]
        return known | {ABOUT: np.array(json.dumps(self._description))}
