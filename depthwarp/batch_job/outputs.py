"""What a batch becomes: here a folder with one 16-bit PNG a view."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from depthwarp.batch_job.views import Views
from depthwarp.batch_job.workplace import Entry, Workplace, disk_errors
from depthwarp.cameras.description import camera_to_dict
from depthwarp.depth_map import DepthMap
from depthwarp.devices import usable_cores
from depthwarp.encodings import Encoding, encode_depth
from depthwarp.errors import InputError

__all__ = ["Output", "PngFolder"]


class Output(ABC):
    """Where views are written; entered, it is locked against other runs.

    Args:
        path: What the person calls the output.
        folder: Where the batch comes about.
        views: The views.
        others: See `Workplace`.
    """

    def __init__(self, path: Path, folder: Path, views: Views, others: Sequence[str] = ()) -> None:
        self.path, self.views = path, views
        self.work = Workplace(folder, path, others)

    def __enter__(self) -> Output:
        """Lock the output.

        Raises:
            InputError: It cannot be written, holds something else, or another run writes it.
        """
        self.work.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        """Let go of the output; what is written stays."""
        self.work.__exit__(*exception)

    @property
    def done(self) -> int:
        """Number of views that are whole."""
        return int(np.count_nonzero(self.work.done))

    @abstractmethod
    def begin(self, description: Entry) -> None:
        """Begin the batch, or go on with it: `work.done` says what is there.

        Raises:
            InputError: The output was begun with another description, or cannot be written.
        """

    def write(
        self,
        numbers: Sequence[int],
        maps: Sequence[DepthMap],
        wrote: Callable[[Sequence[DepthMap]], None],
    ) -> None:
        """Write views, in order; they count when all of them are on the disk.

        Where a full disk ends it, the views before that count.

        Args:
            numbers: Of the views.
            maps: Their depth maps.
            wrote: Called with the maps, when they count.

        Raises:
            InputError: The disk is full.
        """
        whole: list[Entry] = []
        with disk_errors(self.path):
            try:
                for number, depth_map, entry in zip(
                    numbers, maps, self._put_all(numbers, maps), strict=True
                ):
                    whole.append(self._entry(number, depth_map) | entry)
            finally:
                self.work.record(whole, self._made_of(whole))
        wrote(maps)

    @abstractmethod
    def finish(self) -> None:
        """Do what is left when all views are written.

        Raises:
            InputError: The disk is full.
        """

    @abstractmethod
    def _put_all(self, numbers: Sequence[int], maps: Sequence[DepthMap]) -> Iterator[Entry]:
        """Write view after view; after each, what the journal has to say of its file."""

    @abstractmethod
    def _made_of(self, entries: Sequence[Entry]) -> Iterable[Path]:
        """What must be on the disk before these views count; see `Workplace.record`."""

    def _entry(self, number: int, depth_map: DepthMap) -> Entry:
        """A view as the journal has it."""
        camera = camera_to_dict(depth_map.camera)
        return {
            "view": int(number),
            "name": self.views.names[number],
            "lens": int(self.views.lens_of[number]),
            "pose": camera["pose"],
            "optical_from_world": camera["optical_from_world"],
            "counts": dict(depth_map.stats),
        }


class PngFolder(Output):
    """A folder with one 16-bit PNG a view.

    Args:
        path: The folder.
        views: The views; their names, with `.png`, are the files'.
        encoding: What the numbers mean.
    """

    def __init__(self, path: Path, views: Views, encoding: Encoding) -> None:
        super().__init__(path, path, views)
        self._encoding = encoding
        self._pool = ThreadPoolExecutor(usable_cores())

    def __exit__(self, *exception: object) -> None:
        """Let go of the folder; what is written stays."""
        self._pool.shutdown(cancel_futures=True)
        super().__exit__(*exception)

    def begin(self, description: Entry) -> None:
        """Begin the batch, or go on with it; see `Output.begin`."""
        # Loads the kernel before several threads launch it.
        encode_depth(np.zeros((1, 1), np.float32), self._encoding, device="cpu")
        self.work.begin(description, len(self.views), self._is_whole)

    def finish(self) -> None:
        """Put the journal's lines in the order of the views."""
        with disk_errors(self.path):
            self.work.put_in_order()

    def _put_all(self, numbers: Sequence[int], maps: Sequence[DepthMap]) -> Iterator[Entry]:
        images = self._pool.map(self._image, maps)  # several at once: packing is slow
        for number, image in zip(numbers, images, strict=True):
            target = self.path / self._file(number)
            if "/" in self.views.names[number]:
                target.parent.mkdir(parents=True, exist_ok=True)
            self.work.put(target, image)
            yield {"file": self._file(number), "bytes": len(image)}

    def _made_of(self, entries: Sequence[Entry]) -> Iterable[Path]:
        files = (self.path / entry["file"] for entry in entries)
        return {folder for file in files for folder in file.parents if self.path in folder.parents}

    def _image(self, depth_map: DepthMap) -> bytes:
        import cv2

        values = encode_depth(depth_map.depth, self._encoding, device="cpu")
        done, content = cv2.imencode(".png", values)
        if not done:
            raise InputError(f"cannot write an image of {values.shape[1]} x {values.shape[0]} px")
        return content.tobytes()

    def _file(self, number: int) -> str:
        return self.views.names[number] + ".png"

    def _is_whole(self, entry: Entry) -> bool:
        """Whether a view's file is there, and not cut short, as after a power cut."""
        try:
            is_ours: bool = entry["file"] == self._file(entry["view"])
            return is_ours and (self.path / entry["file"]).stat().st_size == entry["bytes"]
        except OSError:
            return False
