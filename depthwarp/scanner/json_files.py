"""Reading the scanner's own JSON files: their kind and their version first, then their content."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from depthwarp.errors import FileFormatError, InputError

__all__ = ["JsonKind"]

Content = TypeVar("Content")


@dataclass(frozen=True)
class JsonKind:
    """A kind of JSON file: an object that names its kind and the version of its format.

    Attributes:
        noun: What such a file holds, for messages.
        tag: Key and value by which a file names its kind.
        version: The version that this program reads and writes, under the key "version".
        remedy: What to do about a file that cannot be used.
    """

    noun: str
    tag: tuple[str, str]
    version: int
    remedy: str

    @property
    def header(self) -> dict[str, Any]:
        """What a file of this kind begins with."""
        key, name = self.tag
        return {key: name, "version": self.version}

    def read(
        self, path: str | os.PathLike[str], parse: Callable[[dict[str, Any]], Content]
    ) -> Content:
        """Read a file of this kind.

        Args:
            path: The file.
            parse: From the object in the file to what it means; may raise KeyError, TypeError,
                ValueError or OverflowError on odd content, and FileFormatError in its own words.

        Raises:
            InputError: There is no such file, or it cannot be read.
            FileFormatError: A file of another kind or version, or a damaged one.
        """
        path = Path(path)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"cannot read the {self.noun} {path}: {error.strerror}") from error
        except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, nested without end
            raise FileFormatError(f"{path} is not a {self.noun}: {error}") from error
        key, name = self.tag
        if not isinstance(content, dict) or content.get(key) != name:
            raise FileFormatError(f"{path} is not a {self.noun}: its {key} is not '{name}'")
        if content.get("version") != self.version:
            raise FileFormatError(
                f"{path} has version {content.get('version')} of the {self.noun} format, this "
                f"program reads version {self.version}: {self.remedy}, or use the program that "
                "wrote it"
            )
        try:
            return parse(content)
        except FileFormatError:
            raise
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise FileFormatError(
                f"{path} is damaged: {type(error).__name__}: {error}; {self.remedy}"
            ) from error
