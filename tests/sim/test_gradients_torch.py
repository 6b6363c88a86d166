"""Depth and image position of winners in torch's graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError

from .winner_scenes import expected, expected_gradients, make_index, make_scene, seeds_of

torch: Any = pytest.importorskip("torch")

from depthwarp.sim import torch_gradients  # noqa: E402

winner_depth = torch_gradients.winner_depth


def tensors(dtype: Any = None, grad: bool = False) -> tuple[Any, Any, Any, Any, Any]:
    """Points, static map, poses and intrinsics of the scene, and the index map."""
    dtype = torch.float64 if dtype is None else dtype
    scene = [torch.tensor(values, dtype=dtype, requires_grad=grad) for values in make_scene()]
    return (*scene, torch.tensor(make_index()))


@pytest.mark.parametrize("kind", ["range", "z"])
def test_gradcheck(kind):
    """By points, static map, twists of the poses and intrinsics of each camera, float64."""
    points, static, poses, lens, index = tensors(grad=True)
    twist = torch.full((2, 2, 6), 0.05, dtype=torch.float64, requires_grad=True)

    def depth_and_position(points: Any, static: Any, twist: Any, lens: Any) -> Any:
        moved = torch_gradients.se3_exp(twist) @ poses.detach()
        return winner_depth(points, moved, lens, index, depth=kind, static_map=static)

    assert torch.autograd.gradcheck(depth_and_position, (points, static, twist, lens))


def test_gradcheck_of_motions():
    """At 0, in both formulas, and of several twists at once."""
    angles = torch.tensor([0.0, 1e-3, 0.3, 2.0], dtype=torch.float64)
    twists = torch.outer(angles, torch.arange(6) - 1.5).requires_grad_()
    assert torch.autograd.gradcheck(torch_gradients.se3_exp, (twists,))


@pytest.mark.parametrize("kind", ["range", "z"])
def test_values_and_gradients_are_those_of_the_formulas(kind):
    """In float32, the sensor's own type, with gradients for what asks for them alone."""
    points, static, poses, lens, index = tensors(torch.float32)
    poses.requires_grad_()
    depth, uv = winner_depth(points, poses, lens, index, depth=kind, static_map=static)
    wanted = expected(make_scene(), make_index(), kind)
    np.testing.assert_allclose(depth.detach(), wanted[0], rtol=2e-6)
    np.testing.assert_allclose(uv.detach(), wanted[1], rtol=2e-6, atol=4e-5)
    seeds = [torch.tensor(seed, dtype=torch.float32) for seed in seeds_of(make_index())]
    kept = [seed.clone() for seed in seeds]
    torch.autograd.backward([depth, uv], seeds)
    gradient = expected_gradients(kind).poses
    np.testing.assert_allclose(poses.grad, gradient, atol=2e-5 * np.abs(gradient).max())
    assert points.grad is None and static.grad is None and lens.grad is None
    assert all(map(torch.equal, seeds, kept))  # nobody wrote into torch's own gradients


def test_one_lens_for_all_cameras():
    """Its gradient is the sum over the cameras; without a lens there is no position."""
    points, static, poses, lens, index = tensors()
    one = lens[0, 0].clone().requires_grad_()
    many = one.detach().expand(2, 2, 4).contiguous().requires_grad_()
    for given in (one, many):
        winner_depth(points, poses, given, index, static_map=static)[1].sum().backward()
    torch.testing.assert_close(one.grad, many.grad.sum((0, 1)))
    assert one.grad.abs().min() > 0
    assert winner_depth(points, poses, None, index)[1] is None


def test_gradients_that_are_not_dense():
    """Of a sum, where all pixels share one number, and of a turned image."""
    points, static, poses, _, index = tensors()
    points.requires_grad_()
    weights = torch.rand(index.shape, dtype=torch.float64).mT.contiguous()
    depth = winner_depth(points, poses, None, index, static_map=static)[0]
    (by_turned,) = torch.autograd.grad((depth.mT * weights).sum(), points, retain_graph=True)
    (by_dense,) = torch.autograd.grad((depth * weights.mT.contiguous()).sum(), points)
    torch.testing.assert_close(by_turned, by_dense)
    depth = winner_depth(points, poses, None, index, static_map=static)[0]
    (by_sum,) = torch.autograd.grad(depth.sum(), points, retain_graph=True)
    (by_ones,) = torch.autograd.grad(depth, points, torch.ones_like(depth))
    torch.testing.assert_close(by_sum, by_ones)


def test_a_camera_descends_to_where_a_map_was_drawn():
    """Step, gradient by a twist, step of the optimizer: a wall ahead is 20 cm off, then 1 mm."""
    rng = np.random.default_rng(5)
    lens = dw.PinholeCamera.from_fov((70, 60), (32, 24))
    points = torch.full((1, 8000, 3), 5.0)
    points[..., :2] = torch.tensor(rng.uniform(-5, 5, (8000, 2)))
    sensor = dw.sim.DepthSensor(1, 1, None, lens, 8000, "cpu", ("depth", "index"), depth="z")
    pose = torch.eye(4)[None, None]
    measured = torch.tensor(sensor.step(points, pose)["depth"].numpy())
    twist = torch.tensor([0.0, 0.0, 0.2, 0.0, 0.0, 0.0], requires_grad=True)
    optimizer = torch.optim.SGD([twist], lr=0.3)
    differences = []
    for _ in range(20):
        moved = torch_gradients.se3_exp(twist) @ pose
        index = torch.tensor(sensor.step(points, moved.detach())["index"].numpy())
        depth, _ = winner_depth(points, moved, None, index, depth="z")
        difference = (depth - measured)[(depth > 0) & (measured > 0)]
        optimizer.zero_grad()
        (0.5 * difference**2).mean().backward()
        optimizer.step()
        differences.append(difference.detach().square().mean().sqrt().item())
    assert differences[0] == pytest.approx(0.2) and differences[-1] < 1e-3


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("points", lambda t: t.numpy(), "points must be a torch tensor, got ndarray"),
        ("points", lambda t: t.half(), "points must be float32 or float64, got torch.float16"),
        ("poses", lambda t: t.float(), r"poses must be torch.float64, got .*: .to\(torch.float64"),
        ("poses", lambda t: t[0], r"poses must have the shape \(W, C, 4, 4\) with W = 2"),
        ("poses", lambda t: t.mT, r"poses must be contiguous: .contiguous\(\)"),
        ("poses", lambda t: t.to("meta"), "poses must be on cpu as the points are, got meta"),
        ("index", lambda t: t.long(), "index must be torch.int32, got torch.int64"),
        ("index", lambda t: t[:, :1].contiguous(), "index must have the shape .* C = 2, got"),
        ("intrinsics", lambda t: t[0], "intrinsics must have the shape"),
        ("static_map", lambda t: t[None], r"static_map must have the shape \(S, 3\), got"),
        ("depth", lambda t: "x", "depth must be one of 'range', 'z'"),
    ],
)
def test_bad_tensors_are_refused(name, change, message):
    """The message names the argument and says what to do; nothing is converted silently."""
    points, static, poses, lens, index = tensors()
    given = {"points": points, "poses": poses, "intrinsics": lens, "index": index}
    given |= {"static_map": static, "depth": "range"}
    given[name] = change(given[name])
    with pytest.raises(InputError, match=message):
        winner_depth(**given)
