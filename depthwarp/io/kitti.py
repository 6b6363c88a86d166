"""KITTI's Velodyne sweeps: float32 rows of x, y, z, intensity and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError
from depthwarp.io.columns import Offset, cloud_from_columns
from depthwarp.io.rows import binary_rows

__all__ = ["read_kitti"]

ROW = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])


def read_kitti(path: Path, offset: Offset | None) -> PointCloud:
    """Read a KITTI .bin file: coordinates [m] in the sensor's frame, and intensity (0 to 1).

    Raises:
        FileFormatError: The size is not a multiple of 16 bytes, or a nuScenes sweep.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    size = path.stat().st_size
    count = size // ROW.itemsize
    if path.name.lower().endswith(".pcd.bin"):
        # Its size may happen to be a multiple of 16, and the points would be nonsense.
        raise FileFormatError(
            f"{path}: a nuScenes sweep (.pcd.bin) has 5 columns, not KITTI's 4; save it as .npz"
        )
    if size % ROW.itemsize:
        raise FileFormatError(
            f"{path}: {size} bytes are not a multiple of 16 (float32 x y z intensity); {count} "
            "whole points are there: copy the file again if it was cut short"
        )
    rows = binary_rows(path, ROW, start=0, count=count, is_last=True)
    return cloud_from_columns({name: rows[name] for name in ROW.names or ()}, path, offset)
