"""The part of YAML that calibration files use: values, lists, and maps of these.

Anything else (anchors, tags, text over several lines, lists of lists or maps) is refused with its
line.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

__all__ = ["parse"]

COMMENT = re.compile(r"""^((?:[^'"#]|(?<=\S)#|"(?:[^"\\]|\\.)*"|'[^']*')*)(?<!\S)#.*""")
"""A line with a comment, which begins at a # behind white space and outside of quotes."""

QUOTED = re.compile(r"""(?<!\S)(?:"(?:[^"\\]|\\.)*"|'[^']*')""")

FLOW_ENTRY = re.compile(r"([\w./-]+)\s*:\s+(\[[^]]*\]|[^\[{},]*)\s*(?:,\s*|(?=\}))")
"""`key: value` in braces, with the comma behind it."""

LINE = re.compile(r"([\w./-]+)\s*:(?:\s+(.*))?")
"""`key: value`; the value may be missing."""

UNKNOWN = tuple("&*!{}|>%@`?")
"""How a value begins that needs a full YAML parser."""


def parse(text: str) -> dict[str, Any]:
    """The map that a text holds, with values as texts; a key without a value has None.

    Raises:
        ValueError: A line that is not of this form; the message has its number.
    """
    top: dict[str, Any] = {}
    open_maps, key = [(0, top)], ""
    for number, indent, line in _statements(text):
        section = open_maps[-1][1]
        if line == "-" or line.startswith("- "):
            if not key or not isinstance(section[key], list | None):
                raise ValueError(f"line {number}: an item without a list, {line[:60]!r}")
            section[key] = [*(section[key] or []), _scalar(line[1:].strip(), number)]
            continue
        match = LINE.fullmatch(line)
        if match is None:
            raise ValueError(f"line {number}: not of the form 'key: value', {line[:60]!r}")
        if indent > open_maps[-1][0]:
            if not key or section[key] is not None:
                raise ValueError(f"line {number}: {line[:60]!r} is indented under no key")
            section[key] = {}
            open_maps.append((indent, section[key]))
        while indent < open_maps[-1][0]:
            open_maps.pop()
        depth, section = open_maps[-1]
        if indent != depth:
            raise ValueError(f"line {number}: {line[:60]!r} is indented otherwise than above")
        key = match[1]
        if key in section:
            raise ValueError(f"line {number}: '{key}' stands twice")
        section[key] = _value((match[2] or "").strip(), number)
    return top


def _statements(text: str) -> Iterator[tuple[int, int, str]]:
    """Line number, indentation and content; what is in brackets over several lines as one.

    Raises:
        ValueError: A tab, brackets without an end, or a second document.
    """
    begun, start, indent, ended, any_content = "", 0, 0, False, False
    for number, full_line in enumerate(text.splitlines(), 1):
        line = COMMENT.sub(r"\1", full_line).rstrip()
        content = line.strip()
        if not content:
            continue
        if content in ("---", "...") and not begun:
            ended = any_content
            continue
        if ended:
            raise ValueError(
                f"line {number}: a second document; keep one, as `ros2 topic echo --once` prints"
            )
        any_content = True
        if not begun:
            start, indent = number, len(line) - len(line.lstrip(" "))
            if line[indent] == "\t":
                raise ValueError(f"line {number}: indented with a tab, which YAML does not allow")
        begun = f"{begun} {content}".strip()
        bare = QUOTED.sub("", begun)
        if all(bare.count(a) <= bare.count(b) for a, b in ("[]", "{}")):
            yield start, indent, begun
            begun = ""
    if begun:
        raise ValueError(f"line {start}: the list in brackets has no end")


def _value(text: str, number: int) -> str | list[str] | dict[str, Any] | None:
    if text in ("", "~", "null"):
        return None
    if text.startswith("{"):
        return _flow_map(text, number)
    if not text.startswith("["):
        return _scalar(text, number)
    if not text.endswith("]"):
        raise ValueError(f"line {number}: text behind a list, {text[-60:]!r}")
    items = text[1:-1].strip().removesuffix(",")
    return [_scalar(item.strip(), number) for item in items.split(",")] if items else []


def _flow_map(text: str, number: int) -> dict[str, Any]:
    """A map in braces, of values and lists."""
    entries: dict[str, Any] = {}
    rest = text[1:].strip()
    while not rest.startswith("}"):
        match = FLOW_ENTRY.match(rest)
        if match is None or match[1] in entries:
            raise ValueError(
                f"line {number}: a value of a form that is not understood, {rest!r:.60}"
            )
        entries[match[1]] = _value(match[2].strip(), number)
        rest = rest[match.end() :]
    if rest != "}":
        raise ValueError(f"line {number}: text behind a map, {rest[-60:]!r}")
    return entries


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
