"""`examples/refine_pose.py` finds the pose that it says it finds."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "refine_pose.py"


def test_a_wrong_pose_is_refined(capsys, monkeypatch):
    """From 5 cm and 2 degrees to under 1 mm and 0.05 degrees, with a table of how."""
    spec = importlib.util.spec_from_file_location("refine_pose", EXAMPLE)
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, example)  # where dataclasses look it up
    spec.loader.exec_module(example)
    assert example.error_of(example.wrong_pose(0))[1] > 1.9
    position, angle = example.refine()
    assert position < 1.0 and angle < 0.05
    table = capsys.readouterr().out.splitlines()
    assert len(table) == 10 and float(table[1].split()[2]) == pytest.approx(50, abs=0.01)
