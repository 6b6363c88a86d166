"""Many poses as rows of numbers: small in memory, and made into a `Pose` when a view is drawn."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras import Pose
from depthwarp.cameras.formats.lines import finite_numbers
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.npz import read_arrays

__all__ = ["CSV_COLUMNS", "NPZ_ARRAY", "PoseTable", "csv_poses", "npz_poses", "table_of"]

Float64Array = npt.NDArray[np.float64]

CSV_COLUMNS = ("x", "y", "z", "roll", "pitch", "yaw")
"""Columns of a CSV of poses: position P_C [m] and orientation C_O [degrees], in the world frame."""

NPZ_ARRAY = "optical_from_world"
"""The array of an NPZ of poses, shape (V, 4, 4)."""

NAME_COLUMN = "name"

SUSPECT_ERROR = 5e-5
"""Entry of R R^T - I from which on a matrix is looked at alone: half of what `Pose` takes."""


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Poses by their numbers.

    Attributes:
        rows: What is known of each pose, shape (V, n), float64.
        pose_of: Makes the pose of a row.
    """

    rows: Float64Array
    pose_of: Callable[[Float64Array], Pose]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, number: int) -> Pose:
        return self.pose_of(self.rows[number])


def table_of(poses: Sequence[Pose]) -> PoseTable:
    """The same poses, bit for bit, as rows."""
    rows = [(*sum(pose.camera_from_world, ()), *pose.position, *pose.shift) for pose in poses]
    return PoseTable(np.array(rows, np.float64), _pose_of_fields)


def csv_poses(path: Path) -> tuple[PoseTable, list[str] | None, Sequence[int]]:
    """Read a CSV: a row of column names, then a pose a row, as `--position` and `--orientation`.

    Columns are x, y, z [m], roll, pitch, yaw [degrees] and, where views have names, name, in any
    order; other columns are passed over. Cells are separated by commas or semicolons.

    Returns:
        The poses, the names if there is such a column, and the line of each.

    Raises:
        FileFormatError: A column is missing, a row is cut short, a cell is no finite number, or
            there is no pose; the message names the line.
    """
    numbers, names, lines = array("d"), list[str](), array("q")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header = file.readline()
            rows = csv.reader(file, delimiter=";" if ";" in header else ",")
            titles = [
                cell.strip().strip('"').lower() for cell in header.split(rows.dialect.delimiter)
            ]
            columns = _columns(path, titles)
            name_column = titles.index(NAME_COLUMN) if NAME_COLUMN in titles else None
            for row in rows:
                line = rows.line_num + 1
                if not any(cell.strip() for cell in row):
                    continue
                if len(row) != len(titles):
                    raise FileFormatError(
                        f"{path}: line {line}: expected {len(titles)} cells, got {len(row)}"
                    )
                words = [row[column].strip() for column in columns]
                numbers.extend(finite_numbers(path, line, words, ", ".join(CSV_COLUMNS)))
                lines.append(line)
                if name_column is not None:
                    names.append(row[name_column].strip())
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileFormatError(f"{path}: not a CSV of poses ({error})") from error
    if not numbers:
        raise FileFormatError(f"{path}: no pose in it; copy or write it again")
    table = np.frombuffer(numbers, np.float64).reshape(-1, len(CSV_COLUMNS))
    return PoseTable(table, _pose_of_orientation), None if name_column is None else names, lines


def npz_poses(path: Path) -> PoseTable | None:
    """Read `optical_from_world`, shape (V, 4, 4), of an NPZ; None if it is a depth map's.

    Raises:
        FileFormatError: A damaged archive, no such array or one of another shape, or a matrix that
            is not rigid (the message names its number and says by how much).
    """
    arrays = read_arrays(path, "an NPZ of poses", "copy or write it again")
    matrices = arrays.get(NPZ_ARRAY)
    if matrices is None and "depth" in arrays:
        return None
    if matrices is None:
        raise FileFormatError(
            f"{path}: no array {NPZ_ARRAY}, of shape (V, 4, 4); it has "
            f"{', '.join(arrays) or 'no arrays'}"
        )
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4) or matrices.dtype.kind not in "fiu":
        raise FileFormatError(
            f"{path}: {NPZ_ARRAY} must be numbers of shape (V, 4, 4), got {matrices.dtype} of "
            f"{matrices.shape}"
        )
    if len(matrices) == 0:
        raise FileFormatError(f"{path}: {NPZ_ARRAY} holds no pose")
    matrices = matrices.astype(np.float64)
    for number in np.flatnonzero(_is_suspect(matrices)):
        try:
            Pose.from_optical(matrices[number])
        except InputError as error:
            raise FileFormatError(f"{path}: pose {number}: {error}") from error
    return PoseTable(matrices.reshape(-1, 16), _pose_of_optical)


def _columns(path: Path, titles: list[str]) -> list[int]:
    """Where the columns of a pose stand."""
    missing = [name for name in CSV_COLUMNS if name not in titles]
    doubled = [name for name in (*CSV_COLUMNS, NAME_COLUMN) if titles.count(name) > 1]
    if missing or doubled:
        wrong = f"no column '{missing[0]}'" if missing else f"two columns '{doubled[0]}'"
        raise FileFormatError(
            f"{path}: line 1: {wrong}; a CSV of poses begins with the names of its columns: "
            f"{','.join(CSV_COLUMNS)} and, if views have names, {NAME_COLUMN}"
        )
    return [titles.index(name) for name in CSV_COLUMNS]


def _is_suspect(matrices: Float64Array) -> npt.NDArray[np.bool_]:
    """Which matrices might not be rigid; fast, so that only these are looked at one by one."""
    rotation = matrices[:, :3, :3]
    with np.errstate(all="ignore"):
        error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        is_good = (error < SUSPECT_ERROR) & (np.linalg.det(rotation) > 0)
    is_good &= np.isfinite(matrices).all(axis=(1, 2))
    suspect: npt.NDArray[np.bool_] = ~(is_good & (matrices[:, 3] == (0, 0, 0, 1)).all(axis=1))
    return suspect


def _pose_of_fields(row: Float64Array) -> Pose:
    v: Any = row.tolist()
    rotation = (tuple(v[0:3]), tuple(v[3:6]), tuple(v[6:9]))
    return Pose(rotation, tuple(v[9:12]), tuple(v[12:15]))


def _pose_of_orientation(row: Float64Array) -> Pose:
    return Pose.from_orientation(row[:3].tolist(), row[3:].tolist())


def _pose_of_optical(row: Float64Array) -> Pose:
    return Pose.from_optical(row.reshape(4, 4))
