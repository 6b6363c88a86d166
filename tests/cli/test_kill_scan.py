"""`depthwarp scan` killed and resumed, as a program of its own."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kill_scan import kill_scans


def test_killed_scans_give_the_cloud_of_an_unbroken_one(tmp_path: Path):
    """SIGKILL inside the turn, then --resume: the same cloud file, byte for byte."""
    outcome = kill_scans(tmp_path, kills=2, seed=3)
    assert outcome.kills >= 2
    assert outcome.inside_turn >= 1
    assert outcome.scans >= 1
    assert outcome.equal == outcome.scans
