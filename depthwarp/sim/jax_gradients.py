"""Gradients of a step in JAX: depth and image position of the winners, and rigid motions.

Import it where JAX is installed: `from depthwarp.sim import jax_gradients`.

The kernel and its adjoint are calls of XLA's foreign function interface inside `jax.custom_vjp`:
they run inside `jit`, on XLA's stream and memory, without a copy. Under `vmap` the mapped axis is
folded into the worlds: one launch for all, and arguments that are not mapped are repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from inspect import Parameter, Signature
from typing import Any

import jax  # pyright: ignore[reportMissingImports]
import jax.numpy as jnp  # pyright: ignore[reportMissingImports]
import numpy as np
import warp as wp

from depthwarp.cameras import DepthKind
from depthwarp.checks import check_choice
from depthwarp.errors import InputError
from depthwarp.sim import se3
from depthwarp.sim.winners import WinnerArrays, check_winner_shapes, run, run_adjoint
from depthwarp_kernels import sim_winners

__all__ = ["se3_exp", "winner_depth"]

SINGLE: Any = wp.float32
DOUBLE: Any = wp.float64


def se3_exp(twist: Any) -> Any:
    """Rigid motions of twists, differentiable, at 0 too; see `depthwarp.sim.se3.se3_exp`.

    Args:
        twist: Translation part [m], then rotation vector [rad], array of the shape (..., 6).

    Returns:
        Matrices, shape (..., 4, 4); `se3_exp(twist) @ poses` moves poses in the optical axes.

    Raises:
        InputError: Another shape.
    """
    return se3.exponential(jnp, jnp.asarray(twist))


def winner_depth(
    points: Any,
    poses: Any,
    intrinsics: Any,
    index: Any,
    *,
    depth: DepthKind = "range",
    static_map: Any = None,
) -> tuple[Any, Any]:
    """Depth and image position of the winners of a step, differentiable by all but the index.

    As `torch_gradients.winner_depth`: pixels without a winner have depth 0, position (0, 0) and no
    gradient; depth does not depend on the intrinsics, so that gradient is exactly zero. Works in
    `jit`, `vmap` and `grad`; reverse mode only, first derivatives only. On CUDA the last bits of a
    gradient may differ between two runs.

    Args:
        points: Each world's own points [m], shape (W, P, 3), float32, or float64 where JAX's
            `jax_enable_x64` is set; the others that are not whole numbers are of the same type.
        poses: optical_from_world, OpenCV axes, shape (W, C, 4, 4).
        intrinsics: fx, fy, cx, cy [px] of a pinhole without distortion, shape (W, C, 4), or (4,)
            for all cameras alike; None: no positions.
        index: Index map, shape (W, C, H, W_px), int32.
        depth: `"range"` or `"z"`, as the sensor's; of an orthographic camera `"z"` for both.
        static_map: Points that all worlds share, shape (S, 3), the first S indices; or None.

    Returns:
        Depth [m], shape (W, C, H, W_px), and (u, v) [px], shape (W, C, H, W_px, 2), or None.

    Raises:
        InputError: Arrays of other shapes or types.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> from depthwarp.sim import jax_gradients
        >>> poses, index = jnp.eye(4)[None, None], jnp.zeros((1, 1, 1, 1), jnp.int32)
        >>> def total(points):
        ...     return jax_gradients.winner_depth(points, poses, None, index)[0].sum()
        >>> jax.jit(jax.grad(total))(jnp.array([[[0.0, 3.0, 4.0]]])).ravel().round(3)
        Array([0. , 0.6, 0.8], dtype=float32)
    """
    check_choice("depth", depth, ("range", "z"))
    optional = {"intrinsics": intrinsics, "static_map": static_map}
    named = {"points": points, "poses": poses, "index": index, **optional}
    given = {name: _adopt(name, value) for name, value in named.items() if value is not None}
    _check_types(given)
    points, poses, lens = given["points"], given["poses"], given.get("intrinsics")
    if lens is not None and lens.shape == (4,):
        given["intrinsics"] = lens = jnp.broadcast_to(lens, (*poses.shape[:2], 4))
    check_winner_shapes({name: tuple(array.shape) for name, array in given.items()})
    static = given.get("static_map", jnp.zeros((0, 3), points.dtype))[None]
    inputs = [points, static, poses] if lens is None else [points, static, poses, lens]
    scalar = SINGLE if points.dtype == jnp.float32 else DOUBLE
    found = _differentiable(scalar, depth == "z", len(inputs))(*inputs, given["index"])
    return found[0], None if lens is None else found[1]


@cache
def _differentiable(scalar: Any, is_z: bool, count: int) -> Any:
    """(points, static, poses[, intrinsics], index) to (depth[, uv]); `count` without the index."""
    uv, point, lens = (wp.types.vector(length, scalar) for length in (2, 3, 4))
    pose = wp.types.matrix((4, 4), scalar)
    kinds: Any = [wp.array(dtype=dtype, ndim=2) for dtype in (point, point, pose, lens)[:count]]
    images: Any = [wp.array(dtype=dtype, ndim=4) for dtype in (scalar, uv)[: count - 2]]
    index_kind: Any = wp.array(dtype=wp.int32, ndim=4)

    def draw(*arrays: Any) -> None:
        run(WinnerArrays(*arrays[:count]), arrays[count], is_z, *arrays[count + 1 :])

    def add_up(*arrays: Any) -> None:
        by_images = arrays[count + 1 : count + 1 + len(images)]
        sums = arrays[-count:]
        for total in sums:
            total.zero_()
        inputs, gradients = WinnerArrays(*arrays[:count]), WinnerArrays(*sums)
        run_adjoint(inputs, arrays[count], is_z, gradients, *by_images)

    drawn = _foreign_call(draw, [*kinds, index_kind, *images], len(images))
    summed = _foreign_call(add_up, [*kinds, index_kind, *images, *kinds], count)

    def forward(*arrays: Any) -> tuple[Any, ...]:
        return tuple(drawn(*arrays, output_dims=arrays[count].shape))

    def forward_and_keep(*arrays: Any) -> tuple[Any, Any]:
        return forward(*arrays), arrays

    def backward(arrays: Any, by_images: Any) -> tuple[Any, ...]:
        first = len(arrays) + len(by_images)
        shapes = {f"a{first + k}": array.shape[:2] for k, array in enumerate(arrays[:count])}
        return (*summed(*arrays, *by_images, output_dims=shapes), None)

    function = jax.custom_vjp(forward)
    function.defvjp(forward_and_keep, backward)
    return function


def _foreign_call(function: Callable[..., None], kinds: list[Any], output_count: int) -> Any:
    """A function of Warp arrays a0, a1, ... of these kinds as one of JAX arrays."""
    names = [f"a{k}" for k in range(len(kinds))]
    parameters = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    signed: Any = function
    signed.__signature__ = Signature(parameters)
    signed.__annotations__ = dict(zip(names, kinds, strict=True))
    # Warp loads the kernels of this module before XLA may record the call in a graph.
    signed.__module__ = sim_winners.__name__
    return wp.jax_callable(signed, num_outputs=output_count, vmap_method="broadcast_all")


def _adopt(name: str, value: Any) -> Any:
    """A JAX array as it is, or a NumPy array as JAX takes it, unless that changes its type."""
    if not isinstance(value, (jax.Array, np.ndarray)):
        raise InputError(f"{name} must be a JAX array, got {type(value).__name__}")
    if jax.dtypes.canonicalize_dtype(value.dtype) != value.dtype:
        raise InputError(
            f"{name} is {value.dtype}, which JAX would make smaller: convert it with .astype, or "
            'set jax.config.update("jax_enable_x64", True)'
        )
    return jnp.asarray(value)


def _check_types(given: dict[str, Any]) -> None:
    """Refuse anything but arrays of one precision."""
    dtype = given["points"].dtype
    if dtype not in (jnp.float32, jnp.float64):
        raise InputError(f"points must be float32 or float64, got {dtype}")
    for name, array in given.items():
        wanted = jnp.dtype(jnp.int32) if name == "index" else dtype
        if array.dtype != wanted:
            raise InputError(f"{name} must be {wanted}, got {array.dtype}: .astype('{wanted}')")
