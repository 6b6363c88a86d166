"""The harness: peers do the same work, or are refused; what is measured of them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

import depthwarp as dw
from benchmarks import harness, measure
from benchmarks.harness import VIEWS_A_LOOP, DifferentImageError, Settings, measure_peers
from benchmarks.measure import Timing, alternate, read_bandwidth
from benchmarks.memory import memory_beside
from benchmarks.own_peers import OneCall, Plan, Prepared
from benchmarks.peers import PEERS, LeftOutError, NumPy, count_differing_pixels, installed_peers
from benchmarks.report import Machine, ratio_lines, records, result_table
from benchmarks.scenes import FurnishedScene

SCENE = FurnishedScene(20_000, image_size=(96, 80))


class Shifted(NumPy):
    """A peer whose camera is half a pixel off."""

    name = "shifted"

    def view(self, camera):
        return super().view(replace(camera, cx=camera.cx + 0.5))


def measured(peers, views=1):
    """Results on the small scene, one timed run each, without memory."""
    settings = Settings([SCENE], views, repeats=2, with_memory=False)
    return measure_peers(peers, SCENE, SCENE.points_world(), settings)


@pytest.mark.parametrize("views", [1, 6])
def test_all_peers_of_this_machine_draw_the_same_images(views):
    """Each agrees with the kept plan; those without a batch draw a few views from all round."""
    peers, left_out = installed_peers("cpu")
    results = measured(peers, views)
    assert len(peers) + len(left_out) == 8 and "depthwarp" == peers[0].name
    for result in results:
        assert result.views == (views if result.peer.is_batch else min(views, 3))
        assert result.differing_pixels <= 2e-3 * 96 * 80 * result.views
    drawn = [image > 0 for image in peers[0].images()]
    assert len(drawn) == views and all(image.mean() > 0.1 for image in drawn)


def test_a_peer_with_a_wrong_camera_is_refused():
    """Half a pixel aside is another image, in one view as in many: no time is measured."""
    for views in (1, 6):
        with pytest.raises(DifferentImageError, match=r"shifted draws another image.*of 7680"):
            measured([Plan("cpu"), NumPy(), Shifted()], views)


def test_few_views_are_timed_of_a_peer_without_a_batch():
    """Speeds and ratios count views: a loop over four of sixteen is no four times as fast."""

    plan, loop = measured([Plan("cpu"), NumPy()], views=16)
    assert loop.views == len(loop.peer.images()) == VIEWS_A_LOOP and plan.views == 16
    loop = replace(loop, timing=Timing((4.0, 4.0), (4.0, 4.0)))
    plan = replace(plan, timing=Timing((8.0, 8.0), (8.0, 8.0)))
    assert plan.times_as_fast_as(loop) == pytest.approx(2.0)
    assert loop.points_per_s(100)[1] == pytest.approx(100.0)


def test_a_quotient_that_rounds_up_to_the_border_stays_in_the_image():
    """u z < width z, and yet u z / z = width in float32: the point falls into the last column."""
    z = np.random.default_rng(0).uniform(1, 2, 1000).astype(np.float32)
    points = np.stack([np.nextafter(5 * z, np.float32(0)), 1.5 * z, z], axis=1)
    assert (points[:, 0] / z == 5).any() and (points[:, 0] < 5 * z).all()
    peer = NumPy()
    peer.load(points, 10.0)
    image = peer.draw((np.eye(3, 4, dtype=np.float32), (5, 4)))
    assert np.argwhere(image).tolist() == [[1, 4]] and image[1, 4] == z.min()


def test_differing_pixels_are_those_of_another_point():
    """Rounding of the same depth does not count, a missing pixel and another depth do."""
    image = np.array([[0.0, 5.0, 5.0, 500.0]], np.float32)
    other = np.array([[0.0, 5.0005, 0.0, 499.0]], np.float32)
    assert count_differing_pixels(image, image) == 0
    assert count_differing_pixels(other, image) == 2


def test_runs_take_turns_and_ratios_are_of_rounds(monkeypatch):
    """Warm A, A, warm B, B, again; and the median of ratios, which slow spells leave alone."""
    monkeypatch.setattr(measure, "WARM_S", 0.0)
    seen = []
    timings = alternate([lambda: seen.append("a"), lambda: seen.append("b")], repeats=2)
    assert "".join(seen) == "aabbaabb" and len(timings[0].wall_s) == 2
    own, other = Timing((1.0, 9.0, 1.0), (1.0,) * 3), Timing((3.0, 27.0, 2.0), (1.0,) * 3)
    assert own.times_as_fast_as(other) == pytest.approx(3.0)


def _hold(points, is_first, per_point):
    """Work that holds so many bytes a point for a while."""
    np.ones(len(points) * per_point, np.uint8)


def test_memory_is_that_beyond_the_inputs():
    """Work that fills 40 MB beside 4 MB of points grows its process by 40 MB."""
    points = np.zeros((333_333, 3), np.float32)
    grown = memory_beside(_hold, points, 120)
    assert 38e6 < grown < 46e6


def test_read_bandwidth_is_one_of_memory(monkeypatch):
    """Gigabytes a second, also of more threads than the array has to share."""
    monkeypatch.setattr("benchmarks.measure.READ_BYTES", 2**23)
    assert 1e8 < read_bandwidth(3) < 1e13


def test_tables_and_records_of_results():
    """One row and one record a peer; no column of atomics without a GPU; ratios by name."""
    results = measured([Plan("cpu"), Prepared("cpu"), OneCall("cpu"), NumPy()])
    here = Machine({"processor": "P"}, 3e10, 1e10)
    console = Console(width=80, markup=False)
    with console.capture() as captured:
        console.print(result_table(20_000, results, here.read_bytes_per_s))
    text = captured.get()
    assert "dw.render" in text and "atomics" not in text and "…" not in text
    lines = list(ratio_lines(results))
    assert [line.split(":")[0] for line in lines] == ["depthwarp", "prepared", "dw.render"]
    assert all("x NumPy" in line for line in lines)
    done = records(here, SCENE, 1, results, [0.5] * 4, 20_000)
    assert json.loads(json.dumps(done))[1]["peer"] == "prepared"
    assert done[0]["times_as_fast_as"]["depthwarp"] == 1.0
    assert done[0]["scene"]["point_count"] == 20_000
    assert done[1]["bytes_a_point"] == 16 + 16 / 512


def test_peers_that_are_not_there_are_named(monkeypatch):
    """A missing package, or one that cannot work here, is left out with its reason."""

    def cannot(device):
        raise LeftOutError("it takes hours")

    monkeypatch.setitem(PEERS, "torch", cannot)
    assert "torch is left out: it takes hours" in installed_peers("cpu")[1]


def test_the_kernel_cache_is_put_back():
    """Whatever happens inside, Warp's own cache is used again afterwards."""
    import warp as wp

    before = wp.config.kernel_cache_dir
    with pytest.raises(dw.errors.InputError), harness.empty_kernel_cache():
        assert wp.config.kernel_cache_dir != before
        raise dw.errors.InputError("stop")
    assert wp.config.kernel_cache_dir == before
