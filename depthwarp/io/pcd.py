"""PCD, the format of the Point Cloud Library: ascii, binary, binary_compressed; .5 to 0.7."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError
from depthwarp.io.columns import Offset, cloud_from_columns
from depthwarp.io.header import parse_count, read_header
from depthwarp.io.rows import TextTable, binary_rows, check_rows_fit

__all__ = ["read_pcd"]

Entries = dict[str, tuple[int, list[str]]]
"""Line number and words of each header line, by keyword."""

KEYWORDS = {
    "VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA",
}  # fmt: skip
TYPES = {"F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8"}
PADDING = "_"

MAX_ROW_BYTES = 1 << 16
"""Most bytes a point that are believed: the largest PCL descriptors have a few thousand."""

SIZES = struct.Struct("<II")
"""What a compressed body begins with: its size, and its size when decompressed [byte]."""

MAX_COMPRESSED_BODY = 2**31 - 1
"""Largest decompressed body [byte]: the decompressor counts in int32."""

MAX_LZF_RATIO = 88
"""An LZF reference of 3 bytes stands for 264 at most."""


@dataclass(frozen=True)
class Field:
    """One entry of FIELDS with its SIZE, TYPE and COUNT."""

    name: str
    type: str
    count: int

    @property
    def size(self) -> int:
        """Bytes a point."""
        return np.dtype(self.type).itemsize * self.count


@dataclass(frozen=True)
class Header:
    """What stands up to the line DATA, and the offset [byte] of what stands behind it."""

    fields: list[Field]
    points: int
    encoding: str
    body: int


def read_pcd(path: Path, offset: Offset | None) -> PointCloud:
    """Read a PCD file; points without a return (NaN) are kept, in the file's order.

    A packed `rgb` or `rgba` becomes `color` (and `alpha`). VIEWPOINT, where the sensor stood, is
    not applied: the coordinates stay as they are stored.

    Raises:
        FileFormatError: Not a PCD file, cut short, or without x, y, z.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    header = _read_header(path)
    if header.encoding == "binary_compressed":
        columns = _compressed_columns(header, path)
    elif header.encoding == "binary":
        columns = _columns_of_rows(
            binary_rows(
                path, _row_dtype(header), start=header.body, count=header.points, is_last=True
            ),
            header,
        )
    else:
        table = TextTable(path, _row_dtype(header), header.body)
        columns = _columns_of_rows(table.read(header.points), header)
    return cloud_from_columns(_unpack_colors(columns), path, offset)


def _read_header(path: Path) -> Header:
    lines, body = read_header(
        path,
        first="",
        is_last=lambda words: words[:1] == ["DATA"],
        last="DATA ascii|binary|binary_compressed",
    )
    entries: Entries = {}
    for number, words in enumerate(lines, start=1):
        if not words or words[0].startswith("#"):
            continue
        keyword = "FIELDS" if words[0] == "COLUMNS" else words[0]  # its name before version .6
        if keyword not in KEYWORDS or keyword in entries:
            raise FileFormatError(
                f"{path}: line {number}: not a PCD header line: '{' '.join(words)[:80]}'"
            )
        entries[keyword] = (number, words[1:])
    if missing := {"FIELDS", "SIZE", "TYPE", "WIDTH"} - entries.keys():
        raise FileFormatError(f"{path}: the header has no line {', '.join(sorted(missing))}")
    encoding = " ".join(entries["DATA"][1])
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise FileFormatError(
            f"{path}: DATA must be ascii, binary or binary_compressed, got '{encoding[:40]}'"
        )
    return Header(_fields(entries, path), _point_count(entries, path), encoding, body)


def _counts(entries: Entries, keyword: str, path: Path) -> list[int]:
    """The whole numbers of one header line."""
    number, words = entries[keyword]
    return [parse_count(path, number, word) for word in words]


def _fields(entries: Entries, path: Path) -> list[Field]:
    names, kinds = entries["FIELDS"][1], entries["TYPE"][1]
    sizes = _counts(entries, "SIZE", path)
    repeats = _counts(entries, "COUNT", path) if "COUNT" in entries else [1] * len(names)
    if not len(names) == len(sizes) == len(kinds) == len(repeats):
        raise FileFormatError(
            f"{path}: FIELDS, SIZE, TYPE and COUNT have {len(names)}, {len(sizes)}, {len(kinds)} "
            f"and {len(repeats)} entries; they must have as many each"
        )
    fields = [
        _field(name, f"{kind}{size}", repeat, path)
        for name, kind, size, repeat in zip(names, kinds, sizes, repeats, strict=True)
    ]
    if sum(field.size for field in fields) > MAX_ROW_BYTES:
        raise FileFormatError(
            f"{path}: a point takes more than {MAX_ROW_BYTES} bytes; SIZE or COUNT must be wrong"
        )
    named = [name for name in names if name != PADDING]
    if doubled := {name for name in named if named.count(name) > 1}:
        raise FileFormatError(f"{path}: field '{min(doubled)}' is declared twice")
    if missing := {"x", "y", "z"} - {name.lower() for name in named}:
        raise FileFormatError(
            f"{path}: no field {', '.join(sorted(missing))}; it has {', '.join(named) or 'none'}"
        )
    return fields


def _point_count(entries: Entries, path: Path) -> int:
    sizes: dict[str, int] = {}
    for keyword in ("WIDTH", "HEIGHT", "POINTS"):
        if keyword in entries:
            values = _counts(entries, keyword, path)
            if len(values) != 1:
                raise FileFormatError(
                    f"{path}: line {entries[keyword][0]}: {keyword} must be one number"
                )
            sizes[keyword] = values[0]
    grid = sizes["WIDTH"] * sizes.get("HEIGHT", 1)
    if sizes.get("POINTS", grid) != grid:
        raise FileFormatError(
            f"{path}: POINTS is {sizes['POINTS']}, but WIDTH x HEIGHT is {grid}; correct the header"
        )
    return grid


def _field(name: str, type_: str, count: int, path: Path) -> Field:
    if type_ not in TYPES:
        raise FileFormatError(
            f"{path}: field '{name}': TYPE and SIZE are {type_}; known are "
            f"{', '.join(sorted(TYPES))}"
        )
    if not 1 <= count <= MAX_ROW_BYTES:
        raise FileFormatError(
            f"{path}: field '{name}': COUNT must be 1 to {MAX_ROW_BYTES}, got {count}"
        )
    return Field(name, "<" + type_.lower(), count)


def _row_dtype(header: Header) -> np.dtype[Any]:
    """Structured type of one row; its fields are numbered, because padding has no name."""
    return np.dtype(
        [
            (f"f{k}", field.type, (field.count,)) if field.count > 1 else (f"f{k}", field.type)
            for k, field in enumerate(header.fields)
        ]
    )


def _columns_of_rows(rows: npt.NDArray[Any], header: Header) -> dict[str, npt.NDArray[Any]]:
    return {
        field.name: rows[f"f{k}"] for k, field in enumerate(header.fields) if field.name != PADDING
    }


def _compressed_columns(header: Header, path: Path) -> dict[str, npt.NDArray[Any]]:
    """Columns of a compressed body: two sizes, then the columns, one whole column after another."""
    if header.points == 0:
        return _columns_of_rows(np.empty(0, _row_dtype(header)), header)
    with path.open("rb") as file:
        file.seek(header.body)
        sizes = file.read(SIZES.size)
        if len(sizes) < SIZES.size:
            check_rows_fit(path, claimed=header.points, present=0)
        compressed_size, size = SIZES.unpack(sizes)
        fields = _stored_fields(header, size, path)
        present = path.stat().st_size - header.body - SIZES.size
        if present < compressed_size:
            raise FileFormatError(
                f"{path}: the header claims {header.points} points in {compressed_size} compressed "
                f"bytes, the file holds {present}; it is cut short: copy the file again"
            )
        if size > MAX_LZF_RATIO * compressed_size:
            raise FileFormatError(
                f"{path}: the header claims {header.points} points, but {compressed_size} "
                f"compressed bytes cannot hold their {size}: copy the file again"
            )
        compressed = np.fromfile(file, np.uint8, compressed_size)
    check_rows_fit(path, claimed=header.points, present=header.points)
    data = _decompress(compressed, size, path)
    columns, position = {}, 0
    for field in fields:
        end = position + header.points * field.size
        column = data[position:end].view(field.type)
        if field.count > 1:
            column = column.reshape(header.points, field.count)
        if field.name != PADDING:
            columns[field.name] = column
        position = end
    return columns


def _stored_fields(header: Header, size: int, path: Path) -> list[Field]:
    """The fields in a compressed body: padding is there or left out, the size tells."""
    row = sum(field.size for field in header.fields)
    if size == header.points * row:
        return header.fields
    named = [field for field in header.fields if field.name != PADDING]
    if size == header.points * sum(field.size for field in named):
        return named
    raise FileFormatError(
        f"{path}: the header claims {header.points} points of {row} bytes, the compressed body "
        f"holds {size // row} ({size} bytes); it is damaged: copy the file again"
    )


def _decompress(compressed: npt.NDArray[np.uint8], size: int, path: Path) -> npt.NDArray[np.uint8]:
    """Decompress LZF data that must become exactly `size` bytes."""
    if max(size, compressed.size) > MAX_COMPRESSED_BODY:
        raise FileFormatError(
            f"{path}: the compressed body is larger than {MAX_COMPRESSED_BODY} bytes; save the "
            "file with DATA binary (pcl_convert_pcd_ascii_binary IN OUT 1)"
        )
    import warp as wp

    from depthwarp import arrays
    from depthwarp_kernels import lzf

    data = np.empty(size, np.uint8)
    status = np.zeros(1, np.int32)
    written = np.zeros(1, np.int32)
    wp.launch(
        lzf.lzf_decompress,
        dim=1,
        inputs=[arrays.share(compressed, wp.uint8, "cpu")],
        outputs=[
            arrays.share(data, wp.uint8, "cpu"),
            arrays.share(status, wp.int32, "cpu"),
            arrays.share(written, wp.int32, "cpu"),
        ],
        device="cpu",
    )
    if status[0] != lzf.LZF_OK or written[0] != size:
        raise FileFormatError(
            f"{path}: the compressed body is damaged: {written[0]} of {size} bytes could be "
            "decompressed; copy the file again"
        )
    return data


def _unpack_colors(columns: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Replace a packed colour, 0xAARRGGBB in the bits of a float or an integer."""
    unpacked: dict[str, npt.NDArray[Any]] = {}
    for name, values in columns.items():
        is_packed = values.ndim == 1 and values.dtype.itemsize == 4
        if name not in ("rgb", "rgba") or not is_packed or "color" in unpacked:
            unpacked[name] = values
            continue
        bits = np.ascontiguousarray(values).view("<u4")
        blue_first = bits.view(np.uint8).reshape(-1, 4)
        unpacked["color"] = blue_first[:, 2::-1]
        if name == "rgba":
            unpacked["alpha"] = blue_first[:, 3]
    return unpacked
