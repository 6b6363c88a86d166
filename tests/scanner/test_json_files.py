"""The scanner's own JSON files: kind, version and content are told apart, each with its remedy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.json_files import JsonKind

KIND = JsonKind("parts list", ("kind", "depthwarp parts"), 3, "order it again")


def parse(content: dict[str, Any]) -> list[int]:
    """What such a file holds."""
    return [int(number) for number in content["numbers"]]


def write(path: Path, **entries: Any) -> Path:
    """A file with a right header, unless entries say otherwise."""
    path.write_text(json.dumps({**KIND.header, **entries}))
    return path


def test_a_file_comes_back(tmp_path: Path):
    """Header and content, and nothing else is asked of it."""
    assert KIND.header == {"kind": "depthwarp parts", "version": 3}
    assert KIND.read(write(tmp_path / "a.json", numbers=[1, 2], more=0), parse) == [1, 2]
    assert KIND.read(str(tmp_path / "a.json"), parse) == [1, 2]


@pytest.mark.parametrize("missing", ["nowhere.json", "."])
def test_what_cannot_be_read_is_named(tmp_path: Path, missing: str):
    """No file, or a folder: bad input, not a damaged file."""
    with pytest.raises(InputError, match="cannot read the parts list") as caught:
        KIND.read(tmp_path / missing, parse)
    assert not isinstance(caught.value, FileFormatError)


@pytest.mark.parametrize(
    "content",
    [b"", b"\xff\xfe", b"{", b"[]", b"null", b'"depthwarp parts"', b'{"version": 3}']
    + [b'{"kind": "other", "version": 3}', b"[" * 100_000],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes):
    """Not JSON, not text, nested without end, no object, another kind: none is a parts list."""
    path = tmp_path / "other.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="other.json is not a parts list"):
        KIND.read(path, parse)


@pytest.mark.parametrize("version", [2, 4, "3", None])
def test_other_versions_are_refused_with_what_to_do(tmp_path: Path, version: object):
    """The message names both versions."""
    path = write(tmp_path / "a.json", version=version, numbers=[])
    words = f"version {version} of the parts list format.*reads version 3: order it again"
    with pytest.raises(FileFormatError, match=words):
        KIND.read(path, parse)


@pytest.mark.parametrize("entries", [{}, {"numbers": 7}, {"numbers": ["x"]}, {"numbers": [1e999]}])
def test_odd_content_is_damage(tmp_path: Path, entries: dict[str, Any]):
    """A missing key, a wrong type, a wrong value and an infinite one, each with the remedy."""
    path = write(tmp_path / "a.json", **entries)
    with pytest.raises(FileFormatError, match="a.json is damaged.*order it again"):
        KIND.read(path, parse)


def test_the_contents_own_words_are_kept(tmp_path: Path):
    """A refusal by the one who understands the content is passed on as it is."""

    def refuse(content: dict[str, Any]) -> None:
        raise FileFormatError("part 7 does not exist any more")

    with pytest.raises(FileFormatError, match="^part 7 does not exist any more$"):
        KIND.read(write(tmp_path / "a.json"), refuse)
