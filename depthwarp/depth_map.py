"""A depth map: for every pixel how far, which point, and how it came about."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from depthwarp.cameras import Camera, DepthKind

if TYPE_CHECKING:
    from depthwarp.cloud import PointCloud
    from depthwarp.encodings import EncodingName

__all__ = ["DepthMap", "RenderStats", "State"]


class State(IntEnum):
    """How a pixel came about: the values of `DepthMap.state`.

    A pixel that was erased and then filled reads as filled: a state tells what was done last.

    Attributes:
        EMPTY: No point fell here, and no filter wrote a depth.
        MEASURED: The depth of the point that fell here.
        FILLED: A filter wrote a depth here: of the surface that surrounds this pixel, or of another
            pixel. Fills do so where nothing was measured, a dilation everywhere.
        ERASED: A filter took the point that fell here for one seen through a gap, and emptied the
            pixel; or left its depth on request, which then counts as empty for later filters.
        FILLED_BORDER: A filter continued a surface that ends here or beside here.
    """

    EMPTY = 0
    MEASURED = 1
    FILLED = 2
    ERASED = 3
    FILLED_BORDER = 4


@dataclass(frozen=True)
class RenderStats(Mapping[str, int]):
    """What became of every point; the counts but `total` add up to `total`.

    A point counts under the first reason that applies, in the order of the fields. Readable as
    attributes (`stats.behind`) and as a mapping (`stats["behind"]`, `dict(stats)`).

    Attributes:
        total: Points of the cloud.
        not_finite: A coordinate is NaN or infinite.
        behind: Not ahead of the camera (X <= 0; by z of a fisheye beyond 85 degrees off the axis).
        outside: Ahead, but not in the image (or not in the range view).
        too_far: In the image, but beyond `max_range`.
        too_near: In the image, but nearer than `min_range`, or at the camera's centre.
        hidden: In the image, but another point of the same pixel is nearer.
        drawn: The winner of its pixel.
    """

    total: int
    not_finite: int
    behind: int
    outside: int
    too_far: int
    too_near: int
    hidden: int
    drawn: int

    def __getitem__(self, name: str) -> int:
        """The count of that name."""
        if name not in iter(self):
            raise KeyError(name)
        value: int = getattr(self, name)
        return value

    def __iter__(self) -> Iterator[str]:
        """The names of the counts."""
        return (field.name for field in fields(self))

    def __len__(self) -> int:
        """The number of counts."""
        return len(fields(self))


@dataclass(frozen=True, eq=False)
class DepthMap:
    """A depth map with its provenance.

    Attributes:
        depth: Depth [m], shape (H, W), float32, 0 = empty.
        index: Row of the cloud whose point gave the depth, shape (H, W), int32, -1 = empty.
        state: How the pixel came about, shape (H, W), uint8, values of `State`.
        camera: Where it was seen from, and through which lens.
        kind: `"range"` (Euclidean) or `"z"` (along the optical axis).
        min_range: Smallest depth that was drawn [m].
        max_range: Largest depth that was drawn [m].
        stats: What became of every point of the cloud.
        filters: The filters that were applied, in order, as text.
    """

    depth: npt.NDArray[np.float32]
    index: npt.NDArray[np.int32]
    state: npt.NDArray[np.uint8]
    camera: Camera
    kind: DepthKind
    min_range: float
    max_range: float
    stats: RenderStats
    filters: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Size, camera model, kind of depth, and how much of the image is not empty."""
        height, width = self.depth.shape
        return (
            f"DepthMap({width} x {height} px, {type(self.camera).__name__}, {self.kind}, "
            f"{(self.depth > 0).mean():.1%} not empty)"
        )

    def save(self, path: str | os.PathLike[str], encoding: EncodingName | None = None) -> None:
        """Write the map; the suffix chooses the format.

        `.png`, `.tiff` and `.exr` (extra `exr`) hold the depth alone; a file beside it, its name
        with `.json` added, says how to read it (encoding, depth kind, camera, counts). `.npz`
        holds depth, index, state, the camera and the rest, and needs no second file.

        Args:
            path: File to write: `.png`, `.tiff`, `.tif`, `.exr` or `.npz`.
            encoding: For `.png`: `"range16"` (the default: 65535 is `max_range`), `"millimetres"`
                or `"kitti"` (metres times 256). The other formats are float32 metres.

        Raises:
            InputError: An unknown suffix or encoding, a depth that the encoding cannot hold, or a
                file that cannot be written. Nothing is left behind.
        """
        from depthwarp.saving import save_depth_map

        save_depth_map(self, path, encoding)

    def unproject(self) -> PointCloud:
        """The points that the map shows, on the rays through the pixels' centres.

        Returns:
            One point for each pixel that is not empty, row by row, in the world frame; with the
            attributes `column`, `row` [px], `index` (of the point in the rendered cloud) and
            `state`. Rendered again by the same camera they give the same pixels, and the same
            depth but for the rounding to float32. Only pixels whose own centre is just beyond the
            edge of what the lens draws, or of z depth (see `DepthKind`), have no point.
        """
        from depthwarp.cloud import PointCloud

        points = self.camera.unproject(self)
        row, column = np.nonzero(np.isfinite(points).all(axis=2))
        return PointCloud(
            points[row, column].astype(np.float32),
            {
                "column": column.astype(np.int32),
                "row": row.astype(np.int32),
                "index": self.index[row, column],
                "state": self.state[row, column],
            },
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> DepthMap:
        """Read a map that `save` wrote as `.npz`.

        Raises:
            FileNotFoundError: There is no such file.
            FileFormatError: The file is not a depth map's NPZ.
        """
        from depthwarp.saving import load_depth_map

        return load_depth_map(path)
