"""Batches of arrays: all views, which have one size, stacked."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.batch_job.description import differences, read_description
from depthwarp.batch_job.outputs import Output
from depthwarp.batch_job.views import Views
from depthwarp.batch_job.workplace import Entry, disk_errors
from depthwarp.depth_map import RenderStats
from depthwarp.errors import InputError
from depthwarp.io.atomic import sync

__all__ = ["ARRAYS", "PIXEL_BYTES", "Stacked"]

ARRAYS: dict[str, Any] = {"depth": np.float32, "index": np.int32, "state": np.uint8}
"""The arrays with a value a pixel."""

PIXEL_BYTES = sum(np.dtype(dtype).itemsize for dtype in ARRAYS.values())
"""What these take a pixel [bytes]."""


class Stacked(Output):
    """Arrays `depth`, `index` and `state` (V, H, W), and what is known of each view.

    Until all views are drawn there is a folder beside the output, its name with `.part` added, that
    holds what is there so far; the output appears when it is whole.

    Args:
        path: The output.
        views: The views, all of one size.
        others: Names of what the batch has in the folder.

    Attributes:
        shape: (V, H, W).
        description: Of the batch; set by `begin`.

    Raises:
        InputError: Views of several sizes.
    """

    def __init__(self, path: Path, views: Views, others: Sequence[str]) -> None:
        super().__init__(path, path.with_name(path.name + ".part"), views, others)
        sizes = sorted({lens.size for lens in views.lenses})
        if len(sizes) > 1:
            raise InputError(
                f"cannot write {path}: views of {len(sizes)} sizes do not stack into arrays; give "
                "a folder in its place"
            )
        width, height = sizes[0]
        self.shape = len(views), height, width
        self.description: Entry = {}

    def begin(self, description: Entry) -> None:
        """Begin the batch, or go on with it; see `Output.begin`."""
        self.description = description
        if not self.path.exists():
            self._begin_arrays()
            return
        if different := differences(read_description(self._about(), self.path), description):
            raise InputError(
                f"{self.path} was made with something else: {'; '.join(different)}. Choose another "
                "output"
            )
        self.work.done = np.ones(len(self.views), np.bool_)

    def finish(self) -> None:
        """Put the output together, and remove the folder of its parts."""
        if not self.path.exists():
            with disk_errors(self.path):
                self._put_together()
                sync(self.path.parent)  # its name
        self.work.remove()

    @abstractmethod
    def _begin_arrays(self) -> None:
        """Make the arrays, or go on with those that are there."""

    @abstractmethod
    def _about(self) -> str:
        """What an output that is there says of itself.

        Raises:
            FileFormatError: It is no batch.
        """

    @abstractmethod
    def _put_together(self) -> None:
        """Let the output appear, whole and on the disk."""

    def _known_of_views(self) -> dict[str, npt.NDArray[Any]]:
        """What the journal says of the views, as arrays of V rows."""
        count, names = len(self.views), count_names()
        known: dict[str, npt.NDArray[Any]] = {
            "optical_from_world": np.zeros((count, 4, 4)),
            "lens": self.views.lens_of,
            "counts": np.zeros((count, len(names)), np.int64),
        }
        for entry in self.work.entries():
            known["optical_from_world"][entry["view"]] = entry["optical_from_world"]
            known["counts"][entry["view"]] = [entry["counts"][name] for name in names]
        return known


def count_names() -> list[str]:
    """Names of the columns of `counts`."""
    return list(RenderStats.__dataclass_fields__)
