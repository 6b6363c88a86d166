"""The benchmark of many worlds, on sizes that take seconds."""

from __future__ import annotations

import io
import json
from contextlib import nullcontext

import numpy as np
import pytest
import warp as wp
from rich.console import Console

from benchmarks import sim, sim_measure
from benchmarks.harness import DifferentImageError
from benchmarks.measure import Timing
from benchmarks.sim_measure import Drawn, Measured, count_off_surface, measure_scene
from benchmarks.sim_memory import SteadyLoop, buffer_bytes, watch_steady_loop
from benchmarks.sim_peers import MAKERS, Rays, room_mesh
from benchmarks.sim_report import print_wanted, times_of
from benchmarks.sim_scene import SimScene

SMALL = SimScene(3, 16, 200)


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    """Runs of one step, and the kernels that other tests compiled."""
    monkeypatch.setattr(sim_measure, "RUN_S", 0.0)
    monkeypatch.setattr(sim_measure, "WATCHED_STEPS", 5)
    monkeypatch.setattr(sim_measure, "PAUSE_S", 0.0)
    monkeypatch.setattr("benchmarks.measure.PAUSE_S", 0.0)
    monkeypatch.setattr("benchmarks.measure.READ_BYTES", 2**23)
    monkeypatch.setattr(sim, "empty_kernel_cache", nullcontext)


def test_a_scene_has_other_points_and_a_level_camera_in_every_world():
    """Points on the room's faces, cameras inside it; the same with every call."""
    points, poses = SMALL.points_world(), SMALL.poses()
    assert points.shape == (3, 200, 3) and poses.shape == (3, 1, 4, 4)
    assert points.dtype == poses.dtype == np.float32
    size = np.array(SMALL.room.room_m, np.float32)
    assert ((points == 0) | (points == size)).any(axis=2).all()
    assert not (points[0] == points[1]).all()
    centres = -np.einsum("wij,wi->wj", poses[:, 0, :3, :3], poses[:, 0, :3, 3])
    assert ((centres > 0.9) & (centres < size - 0.9)).all()
    np.testing.assert_allclose(poses[:, 0, 1, :3], [[0, 0, -1]] * 3, atol=1e-6)
    np.testing.assert_array_equal(points, SMALL.points_world())
    assert str(SimScene(1, 64, 1000)) == "1 world x 64 x 64 px x 1,000 points"


def test_a_mesh_of_the_room():
    """Its triangles cover the faces once, however finely they are cut."""
    for divisions in (1, 3):
        corners, triangles = room_mesh((6.0, 5.0, 2.7), divisions)
        assert triangles.shape == (12 * divisions**2, 3)
        a, b, c = corners[triangles].transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        assert area == pytest.approx(2 * (6 * 5 + 6 * 2.7 + 5 * 2.7), rel=1e-5)


def test_rays_meet_the_walls():
    """Z depth of the wall ahead, in a camera that looks along x in the middle of the room."""
    scene = SimScene(1, 33, 10)
    rays = Rays(scene, "cpu")
    pose = np.array([[0, -1, 0, 2.5], [0, 0, -1, 1.35], [1, 0, 0, -3], [0, 0, 0, 1]], np.float32)
    rays._poses.assign(pose[None])
    rays.step()
    image = rays.images()[0]
    assert image[16, 16] == pytest.approx(3.0, rel=1e-6)
    slope = 16 / scene.lens.fx
    assert image[16, 0] == pytest.approx(min(3.0, 2.5 / slope), rel=1e-5)
    assert image[0, 16] == pytest.approx(min(3.0, 1.35 / slope), rel=1e-5)


def test_a_surface_tells_where_a_point_may_be():
    """Between the least and the greatest depth of its pixel and those around; 0 is no point."""
    surface = np.tile(np.arange(1, 6, dtype=np.float32), (1, 5, 1))
    points = surface.copy()
    assert count_off_surface(points, surface) == 0
    points[0, 2] = [2, 1, 4.03, 0, 4]
    assert count_off_surface(points, surface) == 0
    points[0, 2, 2:] = 4.1, 2.9, 4.5
    assert count_off_surface(points, surface) == 2


def test_a_sensor_that_draws_nothing_is_no_peer(monkeypatch):
    """Against rays alone, empty images have no pixel off the surface: they are refused."""
    monkeypatch.setattr(sim_measure, "LEAST_DRAWN", 0.9)  # more than the points of the scene fill
    with pytest.raises(DifferentImageError, match=r"drew \d+ of 768 pixels, too few to compare"):
        measure_scene(SMALL, "cpu", 0.1)


def test_every_peer_draws_the_same_work(capsys):
    """Peers of a scene, each timed; the sensor's buffers, and a loop that allocates nothing."""
    measured = measure_scene(SMALL, "cpu", 0.1)
    names = [drawn.name for drawn in measured.drawn]
    assert names[:2] == ["depthwarp", "depthwarp, graph"] and names[-1] == "rays, 19,200 triangles"
    by_name = {drawn.name: drawn for drawn in measured.drawn}
    assert by_name["depthwarp, graph"].differing_pixels == 0
    assert all(len(drawn.timing.wall_s) == measured.repeats >= 3 for drawn in measured.drawn)
    assert measured.steady.warp_bytes == measured.steady.warp_allocations == 0
    assert 16 * 16 * 4 < measured.bytes_a_world < 20_000


def test_torch_draws_the_same_pixels():
    """torch's scatter and the sensor agree in every pixel, rounding apart."""
    pytest.importorskip("torch")
    measured = measure_scene(SMALL, "cpu", 0.1)
    torch = next(drawn for drawn in measured.drawn if drawn.name == "torch")
    assert torch.differing_pixels <= 2


def test_a_peer_that_draws_something_else_is_refused(monkeypatch):
    """Its time would say nothing."""

    class Wrong(MAKERS["depthwarp"]):
        name = "wrong"

        def images(self):
            return 2 * super().images()

    monkeypatch.setitem(MAKERS, "wrong", Wrong)
    with pytest.raises(DifferentImageError, match="wrong draws another image"):
        measure_scene(SMALL, "cpu", 0.1)


def test_allocations_are_seen():
    """A loop that makes an array each step is not steady, in Warp or in Python."""
    kept = []
    loop = watch_steady_loop(lambda: kept.append(wp.zeros(100, dtype=wp.float32, device="cpu")), 7)
    assert loop.warp_allocations == 7 and loop.warp_bytes == 2800
    loop = watch_steady_loop(lambda: kept.append(np.zeros(1000)), 5)
    assert loop.warp_bytes == 0 and loop.python_kept_bytes >= 40_000
    assert buffer_bytes(lambda: wp.zeros(50, dtype=wp.float64, device="cpu")) == 400


def _measured(own_s: float, torch_s: float, allocated: int) -> Measured:
    timings = {"depthwarp": own_s, "torch": torch_s}
    drawn = [Drawn(name, "1", 0, 1, Timing((s,) * 3, (s,) * 3)) for name, s in timings.items()]
    return Measured(sim.BASE, drawn, 3, 0.5, 100.0, SteadyLoop(5, 0, allocated, 0, 0))


@pytest.mark.parametrize(
    ("torch_s", "allocated", "missed"), [(0.5, 0, False), (0.3, 0, True), (0.5, 8, True)]
)
def test_what_is_to_be_reached(torch_s, allocated, missed):
    """Four times torch, and no byte."""
    text = io.StringIO()
    measured = _measured(0.1, torch_s, allocated)
    assert print_wanted(Console(file=text, width=200), [measured], on_cuda=False) is missed
    assert times_of(measured, "torch") == pytest.approx(torch_s / 0.1)
    assert times_of(measured, "nobody") is None
    assert ("MISSED" in text.getvalue()) is missed


def test_the_command_end_to_end(tmp_path, capsys):
    """Tables on the screen; a JSON line for each scene and peer."""
    file = tmp_path / "sim.jsonl"
    asked = ["--worlds", "2", "3", "--side", "16", "--points", "100", "--seconds", "0.1"]
    assert sim.main([*asked, "--json", str(file)]) == 0
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert {(line["worlds"], line["side"], line["points"]) for line in lines} == {
        (2, 16, 100),
        (3, 16, 100),
    }
    assert {"depthwarp", "depthwarp, graph", "rays, 12 triangles"} <= {
        line["peer"] for line in lines
    }
    assert all(line["images_per_s"][0] <= line["images_per_s"][2] for line in lines)
    text = capsys.readouterr().out
    assert "3 worlds x 16 x 16 px x 100 points" in text and "first call" in text
    assert "memory a world" in text and "other\nwork" in text


def test_axes_grow_and_lose_slow_peers(monkeypatch):
    """One thing grows along each axis, and each scene is measured once.

    A peer is left out of a scene where a step of it would take a tenth of the time for all.
    """
    for on_cuda in (False, True):
        for axis in sim.scenes_of(on_cuda, None, None, None):
            works = [scene.work for scene in axis]
            assert works == sorted(set(works))
    shown = []

    def measured(scene, device, seconds, without):
        shown.append((scene.worlds, without))
        timings = {name: Timing((s,), (s,)) for name, s in (("depthwarp", 1.0), ("slow", 0.3))}
        drawn = [Drawn(name, "1", 0, 1, t) for name, t in timings.items() if name not in without]
        return Measured(scene, drawn, 3, 0.0, 0.0, SteadyLoop(1, 0, 0, 0, 0))

    monkeypatch.setattr(sim, "measure_scene", measured)
    monkeypatch.setattr(sim, "print_scene", lambda console, measured: None)
    options = sim.build_parser().parse_args(["--seconds", "7"])
    axis = [SimScene(n, 8, 36) for n in (1, 2, 8, 9)] + [SimScene(10**9, 4096, 4096)]
    text = io.StringIO()
    done = sim._measure_axes([axis, axis[:1]], options, Console(file=text, width=200))
    assert shown == [(1, set()), (2, set()), (8, {"slow"}), (9, {"slow"})]
    assert [m.scene for m in done] == axis[:4]
    assert "they would take too long: slow" in text.getvalue()
    assert "1,000,000,000 worlds" in text.getvalue() and "memory would not do" in text.getvalue()


def test_bad_arguments_are_refused(capsys):
    """Exit code 2 and a line that says what is wrong."""
    for arguments, said in ((["--worlds", "0"], "above 0"), (["--device", "cuda:77"], "cuda:77")):
        with pytest.raises(SystemExit) as stop:
            sim.main(arguments)
        assert stop.value.code == 2 and said in capsys.readouterr().err
