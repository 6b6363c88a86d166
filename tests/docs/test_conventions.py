"""Every sentence of the lists in `docs/conventions.md` is tested, and says what it says there.

A test names its sentence; a sentence without a test, or a test without a sentence, is an error.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType

import cv2
import pytest

from depthwarp.cameras import formats
from tests.docs import test_camera_models, test_depth, test_frames, test_pixels, test_round_trips

PAGE = Path(__file__).resolve().parents[2] / "docs" / "conventions.md"

SECTIONS = {
    "Frames": test_frames,
    "Pixels": test_pixels,
    "Depth": test_depth,
    "Camera models": test_camera_models,
    "Round trips": test_round_trips,
}


def sentences_of(page: str) -> dict[str, list[str]]:
    """The lists of the page by the headings they stand under."""
    sections = re.split(r"^## (.+)$", page, flags=re.MULTILINE)[1:]
    lists = {
        title: re.findall(r"^- (.+)$", text, re.MULTILINE)
        for title, text in zip(sections[::2], sections[1::2], strict=True)
    }
    return {title: sentences for title, sentences in lists.items() if sentences}


def sentences_named_in(module: ModuleType) -> list[str]:
    """The sentences that a module's tests name, from the top."""
    return [test.sentence for test in vars(module).values() if hasattr(test, "sentence")]


def test_every_section_has_its_tests():
    """The headings with sentences are those of the modules."""
    sections = sentences_of(PAGE.read_text(encoding="utf-8"))
    assert list(sections) == list(SECTIONS)
    assert sum(map(len, sections.values())) > 30


@pytest.mark.parametrize("title", SECTIONS)
def test_every_sentence_has_a_test(title):
    """A section's sentences and their tests are the same, in the same order."""
    sentences = sentences_of(PAGE.read_text(encoding="utf-8"))
    assert sentences_named_in(SECTIONS[title]) == sentences[title]


def test_every_file_format_states_its_convention():
    """The table of files has a row for each format, with the words of its module."""
    rows = re.findall(
        r"^\|[^|]+\| `(\w+)` \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    modules = [
        importlib.import_module(f"depthwarp.cameras.formats.{name}")
        for name in (*formats.FORMATS, *formats.TRAJECTORIES)
    ]
    assert sorted(rows) == sorted((module.NAME, module.CONVENTION) for module in modules)


def test_the_picture_is_there():
    """The page shows one picture, and it can be opened."""
    (name,) = re.findall(r"!\[[^]]+\]\(([^)]+)\)", PAGE.read_text(encoding="utf-8"))
    picture = cv2.imread(str(PAGE.parent / name))
    assert picture is not None and picture.shape[1] >= 1000
