"""PLY, the Stanford polygon format: ASCII and both binary byte orders; the vertices only."""

from __future__ import annotations

import mmap
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path
from depthwarp.io.columns import Offset, cloud_from_columns
from depthwarp.io.header import parse_count, read_header
from depthwarp.io.rows import TextTable, binary_rows

__all__ = ["read_ply", "write_ply"]

# Each type under its name of 1994 and under the one that says its size.
TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
TYPE_NAMES = {code: name for name, code in reversed(TYPES.items())}

BYTE_ORDERS: dict[str, Literal["little", "big"] | None] = {
    "ascii": None,
    "binary_little_endian": "little",
    "binary_big_endian": "big",
}

ROWS_A_BLOCK = 1 << 20
"""Rows that are put together at once while writing."""


@dataclass(frozen=True)
class Property:
    """One property of an element: a number, or a list of numbers behind its length."""

    name: str
    type: str
    length_type: str | None = None


@dataclass(frozen=True)
class Element:
    """One table of the file, such as the vertices or the faces."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(p.length_type is not None for p in self.properties)

    def row_dtype(self, byte_order: str) -> np.dtype[Any]:
        """Structured type of one row, if no property is a list."""
        return np.dtype([(p.name, byte_order + p.type) for p in self.properties])


@dataclass(frozen=True)
class Header:
    """What stands before `end_header`, and the offset [byte] of what stands behind it."""

    byte_order: Literal["little", "big"] | None
    elements: list[Element]
    body: int


def read_ply(path: Path, offset: Offset | None) -> PointCloud:
    """Read the vertices of a PLY file; other elements are passed over.

    Raises:
        FileFormatError: Not a PLY file, cut short, or without vertices that have x, y, z.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    header = _read_header(path)
    position, vertex = _vertex_element(header, path)
    before, after = header.elements[:position], header.elements[position + 1 :]
    is_last = all(element.count == 0 for element in after)
    if header.byte_order is None:
        skip_lines = sum(element.count for element in before)  # a line an item
        table = TextTable(path, vertex.row_dtype("="), header.body, skip_lines)
        rows = table.read(vertex.count, is_last=is_last)
    else:
        rows = binary_rows(
            path,
            vertex.row_dtype("<" if header.byte_order == "little" else ">"),
            start=_skip_elements(before, header, path),
            count=vertex.count,
            is_last=is_last,
        )
    return cloud_from_columns({p.name: rows[p.name] for p in vertex.properties}, path, offset)


def write_ply(cloud: PointCloud, path: Path) -> None:
    """Write a cloud as binary little-endian PLY: x y z, then every attribute.

    `color` becomes red green blue, `normals` nx ny nz, any other attribute with k values a point
    name_0 to name_(k-1). Values are kept; 64-bit integers are written as 32-bit ones.

    Raises:
        InputError: An attribute that PLY cannot hold without loss, or a path that cannot be
            written.
    """
    columns = _ply_columns(cloud, path)
    row = np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment x y z in metres",
        f"element vertex {len(cloud)}",
        *(
            f"property {TYPE_NAMES[values.dtype.str[1:]]} {name}"
            for name, values in columns.items()
        ),
        "end_header",
    ]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(lines) + "\n").encode("ascii"))
        for start in range(0, len(cloud), ROWS_A_BLOCK):
            block = np.empty(min(ROWS_A_BLOCK, len(cloud) - start), row)
            for name, values in columns.items():
                block[name] = values[start : start + len(block)]
            file.write(block.tobytes())


def _read_header(path: Path) -> Header:
    lines, body = read_header(
        path, first="ply", is_last=lambda words: words == ["end_header"], last="end_header"
    )
    byte_order: Literal["little", "big"] | None = None
    format_seen = False
    elements: list[Element] = []
    for number, words in enumerate(lines[1:-1], start=2):
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in BYTE_ORDERS:
                byte_order, format_seen = BYTE_ORDERS[name], True
            case ["element", name, count]:
                elements.append(Element(name, parse_count(path, number, count)))
            case ["property", "list", length_type, type_, name] if (
                elements and TYPES.get(length_type, "f")[0] in "iu" and type_ in TYPES
            ):
                elements[-1].properties.append(Property(name, TYPES[type_], TYPES[length_type]))
            case ["property", type_, name] if elements and type_ in TYPES:
                elements[-1].properties.append(Property(name, TYPES[type_]))
            case _:
                raise FileFormatError(
                    f"{path}: line {number}: not a PLY header line: '{' '.join(words)[:80]}'"
                )
    if not format_seen:
        raise FileFormatError(f"{path}: the header has no line 'format ascii 1.0' or the like")
    return Header(byte_order, elements, body)


def _vertex_element(header: Header, path: Path) -> tuple[int, Element]:
    """The vertices and their place among the elements, checked for use as points."""
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        raise FileFormatError(f"{path}: no element 'vertex'; it has {', '.join(names) or 'none'}")
    position = names.index("vertex")
    vertex = header.elements[position]
    lists = [p.name for p in vertex.properties if p.length_type is not None]
    if lists:
        raise FileFormatError(
            f"{path}: vertex property '{lists[0]}' is a list; only single numbers can be "
            "read: save the file without it"
        )
    properties = [p.name for p in vertex.properties]
    if missing := {"x", "y", "z"} - {name.lower() for name in properties}:
        raise FileFormatError(
            f"{path}: vertices have no {', '.join(sorted(missing))}; they have "
            f"{', '.join(properties) or 'no properties'}"
        )
    if doubled := {name for name in properties if properties.count(name) > 1}:
        raise FileFormatError(f"{path}: vertex property '{min(doubled)}' is declared twice")
    return position, vertex


def _skip_elements(elements: list[Element], header: Header, path: Path) -> int:
    """Offset [byte] of what follows these elements in a binary file."""
    position = header.body
    for element in elements:
        if element.has_lists:
            position = _skip_lists(element, header, path, position)
        else:
            position += element.count * sum(np.dtype(p.type).itemsize for p in element.properties)
    return position


def _skip_lists(element: Element, header: Header, path: Path, position: int) -> int:
    """Offset [byte] behind rows of lists: each length must be read to find the next row."""
    byte_order = header.byte_order or "little"
    # (bytes of the length, whether it is signed, bytes of an item); a number is a list of one.
    steps = [
        (np.dtype(p.length_type).itemsize, p.length_type[0] == "i", np.dtype(p.type).itemsize)
        if p.length_type is not None
        else (0, False, np.dtype(p.type).itemsize)
        for p in element.properties
    ]
    size = path.stat().st_size
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for row in range(element.count):
            for length_bytes, signed, item_bytes in steps:
                length = 1
                if length_bytes:
                    raw = data[position : position + length_bytes]
                    length = int.from_bytes(raw, byte_order, signed=signed)
                position += length_bytes + length * item_bytes
                if length < 0 or position > size:
                    raise FileFormatError(
                        f"{path}: the header claims {element.count} rows of '{element.name}', "
                        f"row {row + 1} runs out of the file; it is cut short or damaged: copy the "
                        "file again"
                    )
    return position


def _ply_columns(cloud: PointCloud, path: Path) -> dict[str, npt.NDArray[Any]]:
    """What to write, by PLY name, each shape (N,), in a type that PLY has."""
    columns: dict[str, npt.NDArray[Any]] = {}
    standard = {"color": ("red", "green", "blue"), "normals": ("nx", "ny", "nz")}
    arrays = {"points": cloud.points_world, **cloud.attributes}
    for attribute, values in arrays.items():
        stored = _ply_array(attribute, values, path)
        if values.ndim == 1:
            parts = {attribute: stored}
        else:
            names: tuple[str, ...] = tuple(f"{attribute}_{k}" for k in range(values.shape[1]))
            if attribute == "points":
                names = ("x", "y", "z")
            elif attribute in standard and values.shape[1] == 3:
                names = standard[attribute]
            parts = {name: stored[:, k] for k, name in enumerate(names)}
        for name, part in parts.items():
            is_word = name.isascii() and name.isprintable() and name.split() == [name]
            if name in columns or not is_word:
                raise InputError(
                    f"cannot write {path}: attribute '{attribute}' needs the PLY property "
                    f"'{name}', which is taken or not one ASCII word; rename it, or save as .npz"
                )
            columns[name] = part
    return columns


def _ply_array(name: str, values: npt.NDArray[Any], path: Path) -> npt.NDArray[Any]:
    """The attribute in a type that PLY has, value for value."""
    if values.ndim <= 2:
        if values.dtype.str[1:] in TYPE_NAMES:
            return values
        if values.dtype == np.bool_:
            return values.astype(np.uint8)
        if values.dtype == np.float16:
            return values.astype(np.float32)
        if values.dtype in (np.int64, np.uint64):
            for narrow in (np.int32, np.uint32):
                limits = np.iinfo(narrow)
                if values.min(initial=0) >= limits.min and values.max(initial=0) <= limits.max:
                    return values.astype(narrow)
    raise InputError(
        f"cannot write {path}: PLY cannot hold attribute '{name}' (shape {values.shape}, "
        f"{values.dtype}) without loss; save as .npz"
    )
