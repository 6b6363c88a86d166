"""The page of results: the newest figures and speeds, from the lines that are kept."""

from __future__ import annotations

import json

from benchmarks import publish

MACHINE = {"processor": "P", "cores": 2, "python": "3.11", "warp": "1.19"}


def _figure(measured, verdict):
    return {
        "machine": MACHINE,
        "device": "cpu",
        "name": "preparing",
        "measured": measured,
        "target": 1.5,
        "unit": "s",
        "is_limit": True,
        "note": "",
        "verdict": verdict,
    }


def _speed(peer, rate, memory, **scene):
    about = {"name": "room", "point_count": 1000, "order": "made"} | scene
    return {
        "machine": MACHINE,
        "scene": about,
        "views": 1,
        "peer": peer,
        "points_per_s": [0.9 * rate, rate, 1.1 * rate],
        "peak_memory_bytes": memory,
    }


def test_the_page_has_the_newest_of_each():
    """A later line replaces the earlier; a scene's peers share a row, another order has its own."""
    speeds = [
        _speed("prepared", 1e8, 3e6),
        _speed("prepared", 5e8, 2e6),
        _speed("NumPy", 7e7, None),
        _speed("NumPy", 9e7, 1e6, order="sorted"),
        {"machine": MACHINE, "peer": "from before scenes had views"},
    ]
    page = publish.page_of([_figure(2.0, "MISSED"), _figure(1.25, "reached")], speeds)
    assert "| preparing | 1.25 | at most 1.5 s | reached |" in page and "MISSED" not in page
    assert "| room | 1,000 | 1 | 500 (2) | 70 |" in page
    assert "| room, sorted | 1,000 | 1 |  | 90 (1) |" in page
    assert "P, 2 cores, Python 3.11, Warp 1.19." in page


def test_the_page_is_written_beside_the_lines(tmp_path, monkeypatch):
    """`--only-page` reads what is kept, also where nothing is yet, and measures nothing."""
    monkeypatch.setattr(publish, "RESULTS", tmp_path)
    assert publish.main(["--only-page"]) == 0
    assert (tmp_path / "README.md").read_text().startswith("# Results")
    (tmp_path / "figures.jsonl").write_text(json.dumps(_figure(None, "not measured")) + "\n")
    assert publish.main(["--only-page"]) == 0
    assert "| preparing | - |" in (tmp_path / "README.md").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"README.md", "figures.jsonl"}


def test_peers_that_differ_stop_it(tmp_path, monkeypatch):
    """No page is written of work that was not the same."""
    monkeypatch.setattr(publish, "RESULTS", tmp_path)
    monkeypatch.setattr("benchmarks.splat.main", lambda arguments: 1)
    assert publish.main([]) == 1 and not list(tmp_path.iterdir())
