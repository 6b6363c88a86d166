"""Depth and image position of winners in JAX: `grad`, `jit`, `vmap`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from depthwarp.errors import InputError

from .winner_scenes import expected, expected_gradients, make_index, make_scene, seeds_of

jax: Any = pytest.importorskip("jax")
jnp: Any = jax.numpy

from jax.test_util import check_grads  # noqa: E402

from depthwarp.sim import jax_gradients  # noqa: E402

winner_depth = jax_gradients.winner_depth


@pytest.fixture(autouse=True)
def double_precision_on_the_cpu() -> Iterator[None]:
    """Both for these tests alone."""
    with jax.default_device(jax.devices("cpu")[0]), jax.enable_x64(True):
        yield


def arrays(dtype: Any = np.float64) -> tuple[Any, Any, Any, Any, Any]:
    """Points, static map, poses and intrinsics of the scene, and the index map."""
    scene = [jnp.asarray(values, dtype) for values in make_scene()]
    return (*scene, jnp.asarray(make_index()))


def weighted(points: Any, static: Any, poses: Any, lens: Any) -> Any:
    """A number that depends on every pixel."""
    depth, uv = winner_depth(points, poses, lens, arrays()[4], static_map=static)
    by_depth, by_uv = seeds_of(make_index())
    return (by_depth * depth).sum() + (by_uv * uv * uv).sum()


@pytest.mark.parametrize("kind", ["range", "z"])
def test_check_grads(kind):
    """By points, static map, twists of the poses and intrinsics, float64, inside `jit`."""
    points, static, poses, lens, index = arrays()

    @jax.jit
    def depth_and_position(points: Any, static: Any, twist: Any, lens: Any) -> Any:
        moved = jax_gradients.se3_exp(twist) @ poses
        return winner_depth(points, moved, lens, index, depth=kind, static_map=static)

    twist = jnp.full((2, 2, 6), 0.05)
    check_grads(depth_and_position, (points, static, twist, lens), order=1, modes=["rev"])


def test_check_grads_of_motions():
    """At 0, in both formulas, and of several twists at once; forwards too."""
    twists = jnp.outer(jnp.array([0.0, 1e-3, 0.3, 2.0]), jnp.arange(6) - 1.5)
    check_grads(jax_gradients.se3_exp, (twists,), order=1, modes=["fwd", "rev"])


@pytest.mark.parametrize("kind", ["range", "z"])
def test_values_and_gradients_are_those_of_the_formulas(kind):
    """In float32, the sensor's own type."""
    points, static, poses, lens, index = arrays(np.float32)

    def depth_and_position(poses: Any) -> Any:
        return winner_depth(points, poses, lens, index, depth=kind, static_map=static)

    (depth, uv), pull_back = jax.vjp(depth_and_position, poses)
    wanted = expected(make_scene(), make_index(), kind)
    np.testing.assert_allclose(depth, wanted[0], rtol=2e-6)
    np.testing.assert_allclose(uv, wanted[1], rtol=2e-6, atol=4e-5)
    by_poses = pull_back(tuple(jnp.asarray(s, np.float32) for s in seeds_of(make_index())))[0]
    gradient = expected_gradients(kind).poses
    np.testing.assert_allclose(by_poses, gradient, atol=2e-5 * np.abs(gradient).max())


def test_vmap_is_a_loop():
    """Over poses and static maps at once, or poses alone; values and all gradients."""
    points, static, poses, lens, _ = arrays()
    motions = jax_gradients.se3_exp(0.02 * jnp.arange(18.0).reshape(3, 6))
    many_poses = motions[:, None, None] @ poses
    many_maps = static + jnp.arange(3.0)[:, None, None]
    function = jax.value_and_grad(weighted, (0, 1, 2, 3))
    for axes in ((None, 0, 0, None), (None, None, 0, None)):
        maps = many_maps if axes[1] == 0 else jnp.broadcast_to(static, many_maps.shape)
        mapped = jax.jit(jax.vmap(function, axes))(
            points, many_maps if axes[1] == 0 else static, many_poses, lens
        )
        for k in range(3):
            single = function(points, maps[k], many_poses[k], lens)
            for ours, one in zip(jax.tree.leaves(mapped), jax.tree.leaves(single), strict=True):
                np.testing.assert_allclose(ours[k], one, rtol=1e-12, atol=1e-12)


def test_one_lens_for_all_cameras():
    """Its gradient is the sum over the cameras, exactly 0 by depth; without it no position."""
    points, static, poses, lens, index = arrays()

    def outputs(lens: Any) -> Any:
        return winner_depth(points, poses, lens, index, static_map=static)

    one = lens[0, 0]
    by_one = jax.grad(lambda lens: outputs(lens)[1].sum())(one)
    by_many = jax.grad(lambda lens: outputs(lens)[1].sum())(jnp.broadcast_to(one, (2, 2, 4)))
    np.testing.assert_allclose(by_one, by_many.sum((0, 1)), rtol=1e-12)
    assert jnp.abs(by_one).min() > 0
    assert not jax.grad(lambda lens: outputs(lens)[0].sum())(one).any()
    assert winner_depth(points, poses, None, index)[1] is None


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("points", lambda a: a.tolist(), "points must be a JAX array, got list"),
        ("points", lambda a: a.astype(np.float16), "points must be float32 or float64, got"),
        ("poses", lambda a: a.astype(np.float32), "poses must be float64, got float32"),
        ("poses", lambda a: a[0], r"poses must have the shape \(W, C, 4, 4\) with W = 2"),
        ("index", lambda a: a.astype(np.int64), "index must be int32, got int64"),
        ("intrinsics", lambda a: a[0], "intrinsics must have the shape"),
        ("static_map", lambda a: a[None], r"static_map must have the shape \(S, 3\), got"),
        ("depth", lambda a: "x", "depth must be one of 'range', 'z'"),
    ],
)
def test_bad_arrays_are_refused(name, change, message):
    """The message names the argument; nothing is converted silently."""
    points, static, poses, lens, index = arrays()
    given = {"points": points, "poses": poses, "intrinsics": lens, "index": index}
    given |= {"static_map": static, "depth": "range"}
    given[name] = change(given[name])
    with pytest.raises(InputError, match=message):
        winner_depth(**given)


def test_doubles_that_jax_would_cut_are_refused():
    """NumPy's float64 without `jax_enable_x64`."""
    scene = make_scene()
    with jax.enable_x64(False), pytest.raises(InputError, match="jax_enable_x64"):
        winner_depth(scene.points, scene.poses, None, make_index())
