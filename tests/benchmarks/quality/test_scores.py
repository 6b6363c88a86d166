"""Labels and scores of the quality benchmark, on a wall behind a post that one can reckon."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import depthwarp as dw
from benchmarks.quality import peers
from benchmarks.quality.cases import Case
from benchmarks.quality.chains import Chain, chains, run
from benchmarks.quality.evaluate import Shot, evaluate
from benchmarks.quality.scanning import scan
from benchmarks.quality.scenes import SCENES, Look, Scene
from benchmarks.quality.scoring import errors, removal
from benchmarks.quality.solids import box_between, upright
from benchmarks.quality.truth import Label, labels, look
from benchmarks.quality.world import World

WALL_X, POST_X, POST_RADIUS = 6.0, 3.0, 0.3
SCENE = Scene(
    "post",
    (
        box_between((WALL_X, WALL_X + 0.1), (-9, 9), (-6, 6)),
        upright(POST_X, 0.0, (-6, 6), POST_RADIUS),
    ),
    scanners=((0.0, 1.5, 0.0),),
    looks=(Look((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),),
    scanner_reach=50.0,
)


@pytest.fixture(scope="module")
def world() -> World:
    """The solids of the scene."""
    return World(SCENE.solids)


@pytest.fixture(scope="module")
def shot(world: World) -> Shot:
    """The camera's view of a dirty scan of the scene."""
    view = look(SCENE, world, SCENE.looks[0])
    measured = scan(SCENE, world, 100_000, dirty=True)
    cloud = dw.PointCloud(measured.points)
    raw = dw.render(cloud, view.camera, depth="z", max_range=50, device="cpu")
    return Shot(view, cloud, raw, labels(measured, world, view.camera, raw.index))


def test_truth_of_a_view(shot: Shot):
    """Exact depth of wall and post, the post's shadow not observed, edges at its two sides."""
    middle = shot.view.depth[331]
    assert middle[0] == pytest.approx(WALL_X) and middle[700] == pytest.approx(WALL_X)
    assert middle[361] == pytest.approx(POST_X - POST_RADIUS, abs=1e-3)
    # From (0, 1.5) the post hides the wall from y = -0.90 to y = -2.15, columns 452 to 577.
    observed = shot.view.observed[331]
    assert observed[300] and not observed[460] and not observed[560] and observed[590]
    half_width = 600 * POST_RADIUS / np.sqrt(POST_X**2 - POST_RADIUS**2)
    for edge in (361.5 - half_width, 361.5 + half_width):
        band = np.flatnonzero(shot.view.band[331])
        assert abs(band - edge).min() <= 1
    assert np.count_nonzero(shot.view.band[331]) == pytest.approx(2 * 12, abs=2)


def test_what_the_post_hides_is_labelled_hidden(shot: Shot):
    """Of the clean points on the wall exactly those behind the post, none on the post's front."""
    drawn = shot.raw.index >= 0
    points = shot.cloud.points_world[np.maximum(shot.raw.index, 0)]
    on_wall = np.abs(points[..., 0] - WALL_X) < 0.03
    angle = np.abs(np.arctan2(points[..., 1], points[..., 0]))
    behind = angle < np.arcsin(POST_RADIUS / POST_X)
    clean = drawn & (shot.label != Label.BOGUS)
    hidden = shot.label == Label.HIDDEN
    assert np.count_nonzero(clean & on_wall & behind) > 200
    assert np.count_nonzero(clean & on_wall & (hidden != behind)) <= 2
    front = points[..., 0] < POST_X - 0.1
    assert np.count_nonzero(clean & front) > 200
    assert not (clean & front & hidden).any()
    bogus = drawn & (shot.label == Label.BOGUS)
    assert 10 < np.count_nonzero(bogus) < 0.05 * np.count_nonzero(drawn)


def test_a_scan_is_what_it_says(world: World):
    """2 % drop-outs, noise of 3 to 4 mm along the ray, nothing bogus when clean, one seed."""
    first, again = (scan(SCENE, world, 50_000) for _ in range(2))
    np.testing.assert_array_equal(first.points, again.points)
    assert not first.bogus.any()
    ways = first.exact - np.array(SCENE.scanners[0])
    noise = np.linalg.norm(first.points - SCENE.scanners[0], axis=1) - np.linalg.norm(ways, axis=1)
    assert 0.003 < noise.std() < 0.004 and abs(noise.mean()) < 2e-4
    dirty = scan(SCENE, world, 50_000, dirty=True)
    assert 0.0005 < dirty.bogus.mean() < 0.02


def test_scores_of_a_chain_that_is_told_the_truth(shot: Shot):
    """The bound leaks nothing and loses nothing; the raw splat loses nothing and leaks."""
    raw, bound = evaluate([shot], [Chain("raw"), Chain("bound", is_bound=True)])
    assert raw.removal.lost == bound.removal.lost == bound.removal.leak == bound.removal.bogus == 0
    drawn = shot.raw.index >= 0
    assert raw.anywhere.leak == np.mean(shot.label[drawn] == Label.HIDDEN) > 0.01
    assert raw.removal.leak == np.mean(shot.label[drawn & shot.view.observed] == Label.HIDDEN)
    assert raw.everywhere.within <= raw.everywhere.coverage < 0.2
    assert raw.band.pixels < raw.everywhere.pixels


def test_lost_counts_what_is_gone(shot: Shot):
    """Everything erased: all lost, no leak; unknown labels do not count."""
    nothing = replace(shot.raw, state=np.full_like(shot.raw.state, dw.State.ERASED))
    counts = removal(shot.raw, nothing, shot.label)
    assert counts.lost == 1 and counts.leak == 0
    unknown = np.full_like(shot.label, Label.UNKNOWN)
    assert removal(shot.raw, nothing, unknown).visible == 0


def test_errors_by_hand():
    """An empty pixel is a miss, and none of the mean."""
    truth, counts = np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([[True, True, True, False]])
    score = errors(np.array([[1.04, 0.0, 3.3, 9.0]]), truth, counts)
    assert (score.coverage, score.within) == (pytest.approx(2 / 3), pytest.approx(1 / 3))
    assert score.mae == pytest.approx(0.17)
    assert score.rmse == pytest.approx(np.sqrt((0.04**2 + 0.3**2) / 2))
    assert (score + score).mae == pytest.approx(score.mae)


@pytest.mark.parametrize("fill", [peers.nearest(10), peers.ip_basic(), peers.inpaint()])
def test_peers_fill_a_gap_in_a_wall(shot: Shot, fill):
    """A wall with every third pixel comes back whole, within a centimetre."""
    depth = np.zeros_like(shot.raw.depth)
    depth[::3, ::3] = 4.0
    wall = replace(shot.raw, depth=depth, state=(depth > 0).astype(np.uint8))
    made = run(Chain("fill", fill=fill), wall, shot.cloud, shot.label).filled
    inner = made.depth[10:-10, 10:-10]
    np.testing.assert_allclose(inner, 4.0, atol=0.01)
    assert (made.state[10:-10, 10:-10] > 0).all()


def test_every_scene_is_fit_for_use():
    """Eight views, all away from the scanners; names of cases are those of the tables."""
    for make in SCENES.values():
        scene = make()
        assert len(scene.looks) == 8
        for where in scene.looks:
            gaps = np.linalg.norm(np.subtract(scene.scanners, where.position), axis=1)
            assert gaps.min() > 0.5
    assert Case("room", 200_000, True).name == "room 0.2M dirty"


def test_what_a_machine_lacks_is_named():
    """Chains are there or left out with a message, never both."""
    found, missing = chains()
    names = [chain.name for chain in found]
    assert {"raw splat", "paper", "IP-Basic", "nearest pixel"} <= set(names)
    assert not [line for line in missing for name in names if line.startswith(f"{name} is")]
