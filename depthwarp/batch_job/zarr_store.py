"""All views of a batch in one Zarr store of version 3: a chunk a view, which is a file."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from depthwarp.batch_job.stacked import ARRAYS, Stacked, count_names
from depthwarp.batch_job.views import Views
from depthwarp.batch_job.workplace import Entry, disk_errors
from depthwarp.depth_map import DepthMap
from depthwarp.errors import FileFormatError, InputError, MissingExtraError
from depthwarp.io.atomic import sync

__all__ = ["ZarrStore"]

WHOLE, METADATA, ABOUT = "whole.zarr", "zarr.json", "about"
EMPTY = {"depth": 0.0, "index": -1, "state": 0}
KNOWN_ROWS = 4096
"""Views in a chunk of what is known of them."""


class ZarrStore(Stacked):
    """One Zarr store with the arrays of `Stacked`, compressed, readable by every Zarr of version 3.

    Description, names of the views and of the columns of `counts` are attributes of its group.

    Args:
        path: The folder that will be the store.
        views: The views, all of one size.

    Raises:
        InputError: Views of several sizes.
        MissingExtraError: The package zarr is not installed.
    """

    def __init__(self, path: Path, views: Views) -> None:
        super().__init__(path, views, [WHOLE])
        self._zarr = load_zarr()
        self._store = self.work.folder / WHOLE
        self._arrays: dict[str, Any] = {}

    def __enter__(self) -> ZarrStore:
        """Lock the store; see `Output.__enter__`."""
        if self.path.is_file():
            raise InputError(
                f"cannot write {self.path}: it is a file, and a .zarr is a folder; choose another "
                "name"
            )
        super().__enter__()
        return self

    def _begin_arrays(self) -> None:
        self.work.begin(self.description, len(self.views), self._is_whole)
        with disk_errors(self.path):
            if not self.work.done.any():
                self._make_store()
            group = self._zarr.open_group(self._store, mode="r+", zarr_format=3)
            # A view of nothing has its chunks too: what is there can be counted.
            self._arrays = {
                name: group[name].with_config({"write_empty_chunks": True}) for name in ARRAYS
            }
            self._remove_unfinished()

    def _put_all(self, numbers: Sequence[int], maps: Sequence[DepthMap]) -> Iterator[Entry]:
        first = 0
        for run in _runs(numbers):
            here = maps[first : first + len(run)]
            first += len(run)
            for name, array in self._arrays.items():
                array[run.start : run.stop] = np.stack([getattr(each, name) for each in here])
            for number in run:
                sizes = {name: self._chunk(name, number).stat().st_size for name in ARRAYS}
                yield {"bytes": sizes}

    def _made_of(self, entries: Sequence[Entry]) -> Iterable[Path]:
        chunks = [self._chunk(name, entry["view"]) for name in ARRAYS for entry in entries]
        return [*chunks, *(self._store / name for name in ARRAYS)]

    def _about(self) -> str:
        try:
            group = self._zarr.open_group(self.path, mode="r", zarr_format=3)
            return json.dumps(group.attrs[ABOUT])
        except (KeyError, ValueError, OSError) as error:
            raise FileFormatError(
                f"cannot write {self.path}: it is there and not a batch; choose another name"
            ) from error

    def _put_together(self) -> None:
        group = self._zarr.open_group(self._store, mode="r+", zarr_format=3)
        for name, values in self._known_of_views().items():
            chunks = (min(len(values), KNOWN_ROWS), *values.shape[1:])
            group.create_array(name, data=values, chunks=chunks, overwrite=True)
        group.attrs.update(
            {
                ABOUT: self.description,
                "count_names": count_names(),
                "names": list(self.views.names),
            }
        )
        for folder, _, files in os.walk(self._store):
            if Path(folder).name not in ARRAYS:  # the chunks of these are on the disk
                for name in files:
                    sync(Path(folder, name))
            sync(Path(folder))
        os.rename(self._store, self.path)

    def _make_store(self) -> None:
        """A group of three arrays, without a chunk."""
        shutil.rmtree(self._store, ignore_errors=True)
        group = self._zarr.create_group(self._store, zarr_format=3)
        for name, dtype in ARRAYS.items():
            group.create_array(
                name,
                shape=self.shape,
                chunks=(1, *self.shape[1:]),
                dtype=dtype,
                fill_value=EMPTY[name],
                dimension_names=("view", "row", "column"),
                chunk_key_encoding={"name": "default", "separator": "."},
            )
            sync(self._store / name / METADATA)
        sync(self._store / METADATA)
        sync(self._store)

    def _remove_unfinished(self) -> None:
        """Remove what a kill left: chunks of views that do not count, and parts of files."""
        done = np.flatnonzero(self.work.done)
        chunks = {METADATA, *(self._chunk("", int(number)).name for number in done)}
        for folder, wanted in [
            (self._store, {METADATA, *ARRAYS}),
            *((self._store / name, chunks) for name in ARRAYS),
        ]:
            with os.scandir(folder) as entries:
                unwanted = [Path(entry.path) for entry in entries if entry.name not in wanted]
            for path in unwanted:
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def _chunk(self, name: str, number: int) -> Path:
        return self._store / name / f"c.{number}.0.0"

    def _is_whole(self, entry: Entry) -> bool:
        """Whether a view's chunks are there, and not cut short."""
        try:
            sizes = {name: self._chunk(name, entry["view"]).stat().st_size for name in ARRAYS}
        except OSError:
            return False
        return bool(sizes == entry["bytes"])


def load_zarr() -> Any:
    """The package zarr.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        import zarr
    except ImportError as error:
        raise MissingExtraError("writing .zarr", "zarr", "zarr") from error
    return zarr


def _runs(numbers: Sequence[int]) -> Iterator[range]:
    """Numbers that grow, as ranges without gaps."""
    values = np.asarray(numbers)
    for part in np.split(values, np.flatnonzero(np.diff(values) != 1) + 1):
        yield range(int(part[0]), int(part[-1]) + 1)
