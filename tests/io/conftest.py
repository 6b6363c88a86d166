"""What the readers' tests share: files to write, real files, the bytes of a PLY and a PCD."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


@pytest.fixture(scope="session")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, bytes | str], Path]:
    """Write a file of this name and content; of the session, so that hypothesis can use it."""
    folder = tmp_path_factory.mktemp("clouds")

    def write(name: str, content: bytes | str) -> Path:
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


@pytest.fixture
def real_file() -> Callable[[str], Path]:
    """A file of the real scans that lie beside the project; skips where they are absent."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"real scan {name} is not here (looked in ../shared/data)")
        return path

    return find
