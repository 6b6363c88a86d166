"""The script for the day a GPU is at hand, run small wherever the tests run."""

from __future__ import annotations

import dataclasses
import json

import pytest

import depthwarp as dw
from benchmarks import gpu_check
from depthwarp.devices import resolve_device

SMALL = gpu_check.Sizes(
    points=30_000, checked_points=5000, worlds=3, copy_bytes=1 << 20, models=("pinhole",)
)


@pytest.fixture(autouse=True)
def short_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Timed runs of a single call."""
    monkeypatch.setattr(gpu_check, "LEAST_RUN_S", 0.0)


def test_every_step_leaves_a_line(device, tmp_path):
    """Comparisons without a difference, all figures, machine and date in every line."""
    file = tmp_path / "results.jsonl"
    assert gpu_check.check(resolve_device(device), SMALL, file) == 0
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert all(line["machine"]["device"] and line["date"] for line in lines)
    compared = {line["check"] for line in lines if line.get("differing") == 0 and "check" in line}
    assert compared >= {"pinhole", "pinhole, prepared", "pinhole, filters"}
    figures = {line["figure"]: line for line in lines if "figure" in line}
    assert set(figures) == {
        "first call",
        "copy",
        "worlds",
        "shuffled",
        "prepare",
        "prepared",
        "sorted",
        "whole run",
    }
    assert figures["sorted"]["stats"] == figures["shuffled"]["stats"]
    assert figures["prepared"]["points_per_s"] > 0 and figures["copy"]["bytes_per_s"] > 0


def test_a_difference_is_found(monkeypatch, tmp_path):
    """Maps that are not the CPU's are counted, and make the run fail."""
    true_render, calls = dw.render, iter(range(100))

    def render(cloud, view, **options):
        return true_render(cloud, view, **options | {"max_range": 4.0 + next(calls) % 2})

    monkeypatch.setattr(dw, "render", render)
    sizes = dataclasses.replace(SMALL, limit_s=0.0)
    assert gpu_check.check(resolve_device("cpu"), sizes, None) > 100


def test_what_does_not_fit_the_time_is_left_out(tmp_path):
    """Without time there are no timings, and a line for each says why."""
    file = tmp_path / "results.jsonl"
    sizes = dataclasses.replace(SMALL, limit_s=0.0)
    assert gpu_check.check(resolve_device("cpu"), sizes, file) == 0
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    left_out = {line["figure"] for line in lines if "figure" in line and "left_out" in line}
    assert left_out == {"worlds", "large cloud"}
