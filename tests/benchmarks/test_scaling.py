"""Scaling curves and the speeds with targets, on sizes that take seconds."""

from __future__ import annotations

import json
from contextlib import nullcontext

import cv2
import pytest

from benchmarks import figures, scaling, splat
from benchmarks.figures import Figure
from benchmarks.scaling import Place, axes, labels
from benchmarks.scaling_plot import AXES, Sample, draw_curves
from benchmarks.scenes import RoomScene


def test_each_axis_lets_one_thing_grow():
    """Points, views, pixels and threads rise along their axis; no place has too many points."""
    for axis, places in axes(1000, "cpu").items():
        amounts = [place.amount for place in places]
        assert amounts == sorted(set(amounts))
        assert all(place.axis == axis for place in places)
        assert all(place.scene.point_count <= 1000 for place in places)
    assert [p.threads for p in axes(10**6, "cpu")["threads"]] == [
        p.amount for p in axes(10**6, "cpu")["threads"]
    ]
    assert max(p.memory_bytes for p in axes(10**8, "cpu")["points"]) > 12e8


def test_scaling_end_to_end(tmp_path, monkeypatch):
    """All axes of a tiny cloud: a record for each place and peer, and a plot."""
    small = RoomScene(2000, image_size=(64, 48))
    places = {
        "points": [Place("points", n, RoomScene(n, image_size=(64, 48))) for n in (1000, 2000)],
        "views": [Place("views", n, small, views=n) for n in (1, 8)],
        "pixels": [Place("pixels", 64 * 48, small)],
        "threads": [Place("threads", n, small, threads=n) for n in (1, 2)],
    }
    monkeypatch.setattr(scaling, "axes", lambda most, device: places)
    monkeypatch.setattr("benchmarks.measure.READ_BYTES", 2**23)
    lines, plot = tmp_path / "scaling.jsonl", tmp_path / "scaling.png"
    assert scaling.main(["--repeats", "1", "--json", str(lines), "--plot", str(plot)]) == 0
    done = [json.loads(line) for line in lines.read_text().splitlines()]
    places_of = {(d["axis"], d["amount"]) for d in done if d["peer"] == "prepared"}
    assert places_of == {(axis, p.amount) for axis, all_of in places.items() for p in all_of}
    assert {d["peer"] for d in done if d["axis"] == "threads"} == {"depthwarp", "prepared"}
    assert all(d["seconds"] > 0 for d in done)
    assert cv2.imread(str(plot)).shape == (940, 1200, 3)


def test_a_curve_ends_before_it_takes_too_long(monkeypatch, capsys):
    """A peer whose next run would take longer than the patience is not run again."""
    monkeypatch.setattr(scaling, "PATIENCE_S", 0.0)
    places = [Place("points", n, RoomScene(n, image_size=(64, 48))) for n in (1000, 2000)]
    console = splat.Console(markup=False)
    samples = list(scaling._curves(places, "cpu", 1, console))
    assert samples and {sample.amount for sample in samples} == {1000}


def test_a_plot_without_a_peer_or_an_axis(tmp_path):
    """Curves that are not there leave their panels empty."""
    samples = [Sample("points", n, "prepared", n * 1e-8, 1.0) for n in (10**5, 10**6)]
    draw_curves(samples, labels(10**6), "a machine", tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000 and set(labels(10)) == set(AXES)


def test_figures_say_what_is_reached_and_what_is_not():
    """At least or at most; what could not be measured is said so, and is not reached."""
    assert Figure("speed", 3.1, 3, "times").verdict == "reached"
    assert Figure("speed", 2.9, 3, "times").verdict == "MISSED"
    assert Figure("time", 1.4, 1.5, "s", is_limit=True).verdict == "reached"
    assert Figure("time", 1.6, 1.5, "s", is_limit=True).verdict == "MISSED"
    assert Figure("speed", None, 3, "times").verdict == "not measured"


def _in_this_process(work, points, *arguments):
    """Work as in a process of its own, first on a few points; 1 MB."""
    work(points[:100], True, *arguments)
    work(points, False, *arguments)
    return 1_000_000


def test_figures_end_to_end(tmp_path, monkeypatch, capsys):
    """`--figures` prints every figure beside its target; exit code 1 where one is missed."""
    monkeypatch.setattr("benchmarks.measure.READ_BYTES", 2**23)
    monkeypatch.setattr(splat, "empty_kernel_cache", nullcontext)
    monkeypatch.setattr(figures, "memory_beside", _in_this_process)
    monkeypatch.setattr(figures, "VIEWS", 3)
    lines = tmp_path / "figures.jsonl"
    asked = ["--figures", "--points", "2000", "--repeats", "1", "--json", str(lines)]
    assert splat.main(asked) == 1  # 2000 points never come to 2000 million a second
    done = [json.loads(line) for line in lines.read_text().splitlines()]
    assert done[0]["name"] == "prepared, one view" and done[0]["verdict"] == "MISSED"
    assert {d["name"] for d in done} >= {"preparing", "peak memory, one shot"}
    assert next(d for d in done if "culling off" in d["name"])["measured"] > 0
    text = capsys.readouterr().out
    assert all(d["name"] in text and f"{d['target']:.4g}" in text for d in done)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--points", "0"], "whole number above 0"),
        (["--scene", "rom"], "there is no scene 'rom'"),
        (["--json", "/no/such/folder/f.jsonl"], "there is no folder"),
        (["--device", "cuda:77"], "is not on this machine"),
    ],
)
def test_bad_arguments_are_refused(arguments, said, capsys):
    """Exit code 2 and a line that says what is wrong."""
    with pytest.raises(SystemExit) as stop:
        splat.main(arguments)
    assert stop.value.code == 2 and said in capsys.readouterr().err


def test_scenes_are_listed(capsys):
    """`--list` names every scene and measures nothing."""
    assert splat.main(["--list"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in splat.SCENES)
