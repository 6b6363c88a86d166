"""`depthwarp bench`: the harness as a command of the program."""

from __future__ import annotations

import json
from contextlib import nullcontext

import pytest


@pytest.fixture
def quick(monkeypatch):
    """No kernel is compiled twice, no process started for the memory, little memory read."""
    monkeypatch.setattr("benchmarks.measure.READ_BYTES", 2**23)
    monkeypatch.setattr("benchmarks.harness.empty_kernel_cache", nullcontext)
    monkeypatch.setattr("benchmarks.harness.peak_memory", lambda *arguments: 1000)


def test_bench_measures_a_tiny_cloud(run, quick):
    """In the source tree: one JSON object on stdout, the tables on stderr, exit code 0."""
    asked = "bench --scene room --points 2000 --views 2 --repeats 1 --device cpu --json".split()
    done = run(*asked)
    assert done.exit_code == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert [result["peer"] for result in results[:3]] == ["depthwarp", "prepared", "dw.render"]
    for result in results:
        assert result["scene"]["point_count"] == 2000 and result["views"] == 2
        assert result["peak_memory_bytes"] == 1000 and result["points_per_s"][1] > 0
    assert "2,000 points" in done.stderr and "prepared" in done.stderr


def test_bench_prints_tables_for_people(run, quick):
    """Without `--json` the tables are the result: on stdout, with a row for each peer."""
    done = run(*"bench --points 1000 --repeats 1 --device cpu".split())
    assert done.exit_code == 0 and "1,000 points" in done.stdout
    assert "prepared" in done.stdout and "points/s" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--scene", "rom"], "there is no scene 'rom'"),
        (["--device", "cuda:77"], "device 'cuda:77' is not on this machine"),
        (["--points", "0"], "--points"),
    ],
)
def test_bad_options_exit_with_2(run, arguments, said):
    """What is not there is named."""
    result = run("bench", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr


def test_without_the_source_tree_the_way_there_is_said(run, monkeypatch, tmp_path):
    """An installed package alone: one line and exit code 2, as JSON where that is asked for."""
    monkeypatch.setattr("depthwarp.__file__", str(tmp_path / "depthwarp" / "__init__.py"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    result = run("bench")
    assert result.exit_code == 2 and "source tree" in result.stderr and "clone" in result.stderr
    assert "source tree" in json.loads(run("bench", "--json").stdout)["error"]
