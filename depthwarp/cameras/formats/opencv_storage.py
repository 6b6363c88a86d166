"""The entries of a `cv2.FileStorage`, read so that damaged ones are errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.errors import FileFormatError

__all__ = ["KIND", "Storage"]

KIND = "an OpenCV calibration"

Float64Array = npt.NDArray[np.float64]


class Storage:
    """The top of a `cv2.FileStorage`, whose errors say which entry is wrong."""

    def __init__(self, path: Path) -> None:
        import cv2

        flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        try:
            self.storage = cv2.FileStorage(path.read_text(encoding="utf-8-sig"), flags)
            self.keys = tuple(self.storage.root().keys())
        # SystemError: what cv2 5 raises for text that it cannot parse.
        except (cv2.error, SystemError) as error:
            raise FileFormatError(
                f"{path} is not {KIND}: cv2.FileStorage cannot read it; copy or write it again if "
                "it was cut short"
            ) from error

    def __contains__(self, key: str) -> bool:
        return key in self.keys

    def node(self, *keys: str) -> Any:
        """The entry under the first of some keys that the file has."""
        found = next((key for key in keys if key in self), None)
        if found is None:
            raise KeyError(" or ".join(keys))
        return self.storage.getNode(found)

    def matrix(self, *keys: str) -> Float64Array:
        """A matrix of numbers, shape (rows, columns), float64; a list of numbers is a row."""
        node = self.node(*keys)
        name = next(key for key in keys if key in self)
        # Not node.mat(): on a damaged file that can end the program.
        if node.isSeq():
            if not all(item.isInt() or item.isReal() for item in _items(node)):
                raise ValueError(f"{name} is not a list of numbers")
            return np.array([[item.real() for item in _items(node)]], dtype=np.float64)
        if not node.isMap():
            raise ValueError(f"{name} is not a matrix")
        shape = tuple(int(side.real()) for side in self._sides(node))
        values = _items(node.getNode("data"))
        if len(values) != np.prod(shape) or not all(v.isInt() or v.isReal() for v in values):
            raise ValueError(f"{name} does not hold {' x '.join(map(str, shape))} numbers")
        return np.array([value.real() for value in values], dtype=np.float64).reshape(shape)

    def _sides(self, node: Any) -> list[Any]:
        """Rows and cols of a matrix, or its sizes, as cv2 5 writes those of a vector."""
        sides = _items(node.getNode("sizes")) or [node.getNode("rows"), node.getNode("cols")]
        if not all(side.isInt() and side.real() >= 0 for side in sides):
            raise ValueError("a matrix without whole numbers of rows and columns")
        return sides

    def number(self, *keys: str) -> float:
        """A number."""
        node = self.node(*keys)
        if not (node.isInt() or node.isReal()):
            raise ValueError(f"{' or '.join(keys)} is not a number")
        return float(node.real())


def _items(node: Any) -> list[Any]:
    """The items of a sequence; one number alone is a sequence too: XML does not tell them apart."""
    if node.isSeq():
        return [node.at(k) for k in range(node.size())]
    return [node] if node.isInt() or node.isReal() else []
