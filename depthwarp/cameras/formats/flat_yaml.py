"""The part of YAML that calibration files use: values, lists, and maps of these one level deep.

Anything else (anchors, tags, text over several lines, deeper maps) is refused with its line.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

__all__ = ["parse"]

LINE = re.compile(r"([\w./-]+)\s*:(?:\s+(.*))?")
"""`key: value`; the value may be missing."""

UNKNOWN = tuple("&*!{|>%@`?")
"""How a value begins that needs a full YAML parser."""


def parse(text: str) -> dict[str, Any]:
    """The map that a text holds, with values as texts; a key without a value has None.

    Raises:
        ValueError: A line that is not of this form; the message has its number.
    """
    top: dict[str, Any] = {}
    section, depth, key = top, 0, ""
    for number, indent, line in _statements(text):
        if line == "-" or line.startswith("- "):
            if not key or not isinstance(section[key], list | None):
                raise ValueError(f"line {number}: an item without a list, {line[:60]!r}")
            section[key] = [*(section[key] or []), _scalar(line[1:].strip(), number)]
            continue
        match = LINE.fullmatch(line)
        if match is None:
            raise ValueError(f"line {number}: not of the form 'key: value', {line[:60]!r}")
        if indent == 0:
            section = top
        elif section is top:
            if not key or top[key] is not None:
                raise ValueError(f"line {number}: {line[:60]!r} is indented under no key")
            section, depth = {}, indent
            top[key] = section
        elif indent != depth:
            raise ValueError(f"line {number}: {line[:60]!r} is indented otherwise than above")
        key = match[1]
        if key in section:
            raise ValueError(f"line {number}: '{key}' stands twice")
        section[key] = _value((match[2] or "").strip(), number)
    return top


def _statements(text: str) -> Iterator[tuple[int, int, str]]:
    """Line number, indentation and content; a list in brackets over several lines as one."""
    begun, start, indent = "", 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        line = line.rstrip() if "'" in line or '"' in line else re.sub(r"(^|\s)#.*", "", line)
        content = line.strip()
        if not content or (content in ("---", "...") and not begun):
            continue
        if not begun:
            start, indent = number, len(line) - len(line.lstrip(" "))
            if content.startswith("\t") or line[indent] == "\t":
                raise ValueError(f"line {number}: indented with a tab, which YAML does not allow")
        begun = f"{begun} {content}".strip()
        if begun.count("[") <= begun.count("]"):
            yield start, indent, begun
            begun = ""
    if begun:
        raise ValueError(f"line {start}: the list in brackets has no end")


def _value(text: str, number: int) -> str | list[str] | None:
    if text in ("", "~", "null"):
        return None
    if not text.startswith("["):
        return _scalar(text, number)
    if not text.endswith("]"):
        raise ValueError(f"line {number}: text behind a list, {text[-60:]!r}")
    items = text[1:-1].strip().removesuffix(",")
    return [_scalar(item.strip(), number) for item in items.split(",")] if items else []


def _scalar(text: str, number: int) -> str:
    if text.startswith('"'):
        try:
            return str(json.loads(text))
        except ValueError as error:
            raise ValueError(f"line {number}: not a text in quotes, {text[:60]!r}") from error
    if text.startswith("'") and text.endswith("'") and len(text) > 1:
        return text[1:-1].replace("''", "'")
    if not text or text.startswith((*UNKNOWN, "[", "- ", "'")):
        raise ValueError(f"line {number}: a value of a form that is not understood, {text[:60]!r}")
    return text
