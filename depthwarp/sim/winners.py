"""Depth and image position of the winning points as smooth functions: the hook for Warp's tape.

A rendered depth map is piecewise smooth: which point wins a pixel jumps, and has no derivative;
between the jumps a pixel's depth is that of one point, and has exact derivatives by the point and
by the pose. So a gradient costs nothing while rendering. It starts from the index map of a finished
step and computes depth, and if asked for (u, v), of the same winners once more:

    p = R x + t                     the winner x in OpenCV's optical axes, pose (R, t)
    depth = |p| or p_z              kind "range" or "z"
    u = cx + fx p_x / p_z           and v = cy + fy p_y / p_z, of a pinhole camera

The depth of a winner does not depend on the lens: its derivatives by the intrinsics are exactly
zero. What a lens changes is where a winner appears, which is what (u, v) is for.

All poses are optical_from_world with column vectors; their twelve numbers are taken as they are, as
if independent. For steps that stay rigid multiply by `se3_exp`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from depthwarp.cameras import DepthKind
from depthwarp.checks import check_choice
from depthwarp.errors import InputError
from depthwarp_kernels.sim_winners import WINNER_DEPTH

__all__ = ["WinnerArrays", "check_winner_shapes", "launch_winner_depth", "run", "run_adjoint"]

LANE_PIXELS = 16
"""Pixels whose gradients by the pose are summed before they go to memory."""

Shape = tuple[int, ...]


@dataclass(frozen=True)
class WinnerArrays:
    """What winners depend on, as `wp.array`; or the gradients of these, where None is unasked.

    Attributes:
        points: Points in the world frame [m], vectors of 3, shape (W, P).
        static_points: Points that worlds share, vectors of 3, shape (rows, S): each row serves
            W / rows worlds, one behind the other.
        poses: optical_from_world, 4 x 4 matrices, shape (W, C).
        intrinsics: (fx, fy, cx, cy) [px], vectors of 4, shape (W, C); None without positions.
    """

    points: Any
    static_points: Any
    poses: Any
    intrinsics: Any = None

    @property
    def as_inputs(self) -> list[Any]:
        """The arrays in the kernel's order."""
        return [self.points, self.static_points, self.poses, self.intrinsics]


def launch_winner_depth(
    points: Any,
    poses: Any,
    index: Any,
    depth_out: Any,
    *,
    intrinsics: Any = None,
    uv_out: Any = None,
    static_map: Any = None,
    depth: DepthKind = "range",
) -> None:
    """Compute depth, and if asked for the image position, of the winners; a tape records it.

    One launch: no allocation, no synchronization, capturable; it runs on the current stream of the
    arrays' device. The backward launch adds to the gradients of those of `points`, `poses`,
    `intrinsics` and `static_map` that require them. Sums by atomics: on CUDA the order of the
    additions, and so the last bits of a gradient, may differ between two runs; on a CPU they do
    not. The depth itself is the sensor's, up to float32's rounding.

    Args:
        points: Each world's own points [m], `wp.vec3f` or `wp.vec3d`, shape (W, P), as they were
            drawn or moved a little since then; the type chooses float32 or float64 for all.
        poses: optical_from_world, `wp.mat44f` or `wp.mat44d`, shape (W, C).
        index: Index map of the step, `wp.int32`, shape (W, C, H, W_px). Pixels with an index below
            0, or beyond the points, are empty: 0 in both outputs, and no gradient.
            A pixel that a filter filled has the winner that the filter gave it; noise is not in it.
        depth_out: Receives the depth [m], shape (W, C, H, W_px).
        intrinsics: (fx, fy, cx, cy) [px], `wp.vec4f` or `wp.vec4d`, shape (W, C); given if and only
            if `uv_out` is.
        uv_out: Receives column and row (u, v) [px] of a pinhole without distortion, `wp.vec2f` or
            `wp.vec2d`, shape (W, C, H, W_px); (0, 0) without gradient where the point, after a move
            of the pose, is not ahead of the camera.
        static_map: Points that all worlds share, `wp.vec3f` or `wp.vec3d`, shape (S,): index i < S
            is its point i, and index S + i a world's own point i. None: S = 0.
        depth: `"range"` or `"z"`, as the sensor's; of an orthographic camera `"z"` for both.

    Raises:
        InputError: Arrays of other shapes, types or devices.

    Example:
        >>> import warp as wp
        >>> from depthwarp.sim.winners import launch_winner_depth
        >>> points = wp.array([[[0, 3, 4]]], dtype=wp.vec3f, device="cpu", requires_grad=True)
        >>> pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        >>> poses = wp.array([[pose]], dtype=wp.mat44f, device="cpu")
        >>> index = wp.array([[[[0, -1]]]], dtype=wp.int32, device="cpu")
        >>> depth = wp.zeros((1, 1, 1, 2), dtype=wp.float32, device="cpu", requires_grad=True)
        >>> with wp.Tape() as tape:
        ...     launch_winner_depth(points, poses, index, depth)
        >>> tape.backward(grads={depth: wp.full_like(depth, 1.0)})
        >>> depth.numpy().ravel(), points.grad.numpy().ravel()
        (array([5., 0.], dtype=float32), array([0. , 0.6, 0.8], dtype=float32))
    """
    check_choice("depth", depth, ("range", "z"))
    given = {"points": points, "poses": poses, "index": index, "depth_out": depth_out}
    optional = {"intrinsics": intrinsics, "uv_out": uv_out, "static_map": static_map}
    given.update({name: array for name, array in optional.items() if array is not None})
    _check_arrays(given)
    if (intrinsics is None) != (uv_out is None):
        raise InputError("intrinsics and uv_out belong together: give both of them, or neither")
    shapes = {name: _full_shape(array) for name, array in given.items()}
    check_winner_shapes(shapes)
    static = _no_points(points) if static_map is None else static_map.reshape((1, -1))
    inputs = WinnerArrays(points, static, poses, intrinsics)
    run(inputs, index, depth == "z", depth_out, uv_out)


def run(inputs: WinnerArrays, index: Any, is_z: bool, depth_out: Any, uv_out: Any = None) -> None:
    """Launch the kernel on checked arrays."""
    wp.launch(
        WINNER_DEPTH[depth_out.dtype],
        dim=_lanes_of(index),
        inputs=[*inputs.as_inputs, index, is_z, _lanes_of(index)[2]],
        outputs=[depth_out, uv_out],
        device=index.device,
    )


def run_adjoint(
    inputs: WinnerArrays,
    index: Any,
    is_z: bool,
    gradients: WinnerArrays,
    depth_gradient: Any,
    uv_gradient: Any = None,
) -> None:
    """Add the gradients by the inputs to `gradients`, given those by the outputs (None: zero)."""
    lanes = _lanes_of(index)
    wp.launch(
        WINNER_DEPTH[inputs.points.dtype._wp_scalar_type_],
        dim=lanes,
        inputs=[*inputs.as_inputs, index, is_z, lanes[2]],
        # The adjoint reads no outputs, only their shapes, which are those of their gradients.
        outputs=[depth_gradient, uv_gradient],
        adj_inputs=[*gradients.as_inputs, None, is_z, lanes[2]],
        adj_outputs=[depth_gradient, uv_gradient],
        adjoint=True,
        device=index.device,
    )


def check_winner_shapes(shapes: dict[str, Shape]) -> None:
    """Refuse shapes that do not belong together; vectors and matrices count as dimensions.

    Args:
        shapes: By name of the argument; those that are not given are left out.

    Raises:
        InputError: One of them does not fit; the message names it.
    """
    _check_shape("points", shapes["points"], ("W", "P", 3), {})
    sizes = {"W": shapes["points"][0]}
    _check_shape("poses", shapes["poses"], ("W", "C", 4, 4), sizes)
    sizes["C"] = shapes["poses"][1]
    _check_shape("index", shapes["index"], ("W", "C", "H", "W_px"), sizes)
    sizes["H"], sizes["W_px"] = shapes["index"][2:]
    wanted: dict[str, Sequence[str | int]] = {
        "static_map": ("S", 3),
        "intrinsics": ("W", "C", 4),
        "depth_out": ("W", "C", "H", "W_px"),
        "uv_out": ("W", "C", "H", "W_px", 2),
    }
    for name, form in wanted.items():
        if name in shapes:
            _check_shape(name, shapes[name], form, sizes)


def _check_shape(name: str, shape: Shape, form: Sequence[str | int], sizes: dict[str, int]) -> None:
    """Compare a shape with letters and numbers; letters without a size are free."""
    expected = [sizes.get(size) if isinstance(size, str) else size for size in form]
    fits = len(shape) == len(expected) and all(
        wanted in (None, size) for size, wanted in zip(shape, expected, strict=True)
    )
    if not fits:
        letters = f"({', '.join(map(str, form))})"
        known = ", ".join(f"{letter} = {sizes[letter]}" for letter in form if letter in sizes)
        raise InputError(
            f"{name} must have the shape {letters}{known and f' with {known}'}, got {tuple(shape)}"
        )


def _check_arrays(given: dict[str, Any]) -> None:
    """Refuse anything but Warp arrays of one precision on one device."""
    for name, array in given.items():
        if not isinstance(array, wp.array):
            raise InputError(f"{name} must be a wp.array, got {type(array).__name__}")
    points = given["points"]
    double = points.dtype == wp.vec3d
    dtypes = {
        "points": wp.vec3d if double else wp.vec3f,
        "static_map": wp.vec3d if double else wp.vec3f,
        "poses": wp.mat44d if double else wp.mat44f,
        "intrinsics": wp.vec4d if double else wp.vec4f,
        "index": wp.int32,
        "depth_out": wp.float64 if double else wp.float32,
        "uv_out": wp.vec2d if double else wp.vec2f,
    }
    for name, array in given.items():
        wanted: Any = dtypes[name]
        if array.dtype != wanted or array.device != points.device or not array.is_contiguous:
            raise InputError(
                f"{name} must be a contiguous wp.array of {wanted.__name__} on "
                f"{points.device.alias}, got {array.dtype.__name__} on {array.device.alias}"
            )


def _full_shape(array: Any) -> Shape:
    return (*array.shape, *getattr(array.dtype, "_shape_", ()))


def _no_points(points: Any) -> Any:
    """A static map without points: no memory."""
    return wp.array(ptr=None, dtype=points.dtype, shape=(1, 0), device=points.device)


def _lanes_of(index: Any) -> tuple[int, int, int]:
    worlds, cameras, rows, columns = index.shape
    return worlds, cameras, -(-rows * columns // LANE_PIXELS)
