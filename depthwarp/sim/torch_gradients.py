"""Gradients of a step in torch: depth and image position of the winners, and rigid motions.

Import it where torch is installed: `from depthwarp.sim import torch_gradients`.

Zero copy: tensors are read where they are, and outputs and gradients are tensors of torch's own
memory. On CUDA all of it runs on torch's current stream of the tensors' device, forwards and
backwards, and so needs no synchronization with other work of that stream.
"""

from __future__ import annotations

from typing import Any

import torch  # pyright: ignore[reportMissingImports]
import warp as wp

from depthwarp.cameras import DepthKind
from depthwarp.checks import check_choice
from depthwarp.errors import InputError
from depthwarp.sim import se3
from depthwarp.sim.handed import stream_scope
from depthwarp.sim.winners import WinnerArrays, check_winner_shapes, run, run_adjoint

__all__ = ["se3_exp", "winner_depth"]

_VECTORS: dict[Any, dict[str, Any]] = {
    torch.float32: {"points": wp.vec3f, "poses": wp.mat44f, "lens": wp.vec4f, "uv": wp.vec2f},
    torch.float64: {"points": wp.vec3d, "poses": wp.mat44d, "lens": wp.vec4d, "uv": wp.vec2d},
}


def se3_exp(twist: Any) -> Any:
    """Rigid motions of twists, differentiable, at 0 too; see `depthwarp.sim.se3.se3_exp`.

    Args:
        twist: Translation part [m], then rotation vector [rad], tensor of the shape (..., 6).

    Returns:
        Matrices, shape (..., 4, 4); `se3_exp(twist) @ poses` moves poses in the optical axes.

    Raises:
        InputError: Another shape.
    """
    return se3.exponential(torch, twist)


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

    The step itself needs no gradient: give the index map that it returned and the points and poses
    that it drew. Pixels without a winner have depth 0, position (0, 0) and no gradient. Depth does
    not depend on the intrinsics: that gradient is exactly zero, use the position. Gradients are
    summed by atomics: on CUDA the order of the additions, and so the last bits, may differ between
    two runs. There are no second derivatives, and
    the transforms of `torch.func` do not apply.

    Args:
        points: Each world's own points [m], shape (W, P, 3), float32 or float64; the others that
            are not whole numbers are of the same type, and all on one device.
        poses: optical_from_world, OpenCV axes, shape (W, C, 4, 4).
        intrinsics: fx, fy, cx, cy [px] of a pinhole without distortion, shape (W, C, 4), or (4,)
            for all cameras alike; None: no positions.
        index: Index map, shape (W, C, H, W_px), int32.
        depth: `"range"` or `"z"`, as the sensor's; of an orthographic camera `"z"` for both.
        static_map: Points that all worlds share, shape (S, 3), the first S indices; or None.

    Returns:
        Depth [m], shape (W, C, H, W_px), and (u, v) [px], shape (W, C, H, W_px, 2), or None.

    Raises:
        InputError: Tensors of other shapes, types or devices, or not contiguous.

    Example:
        >>> import torch
        >>> from depthwarp.sim import torch_gradients
        >>> points = torch.tensor([[[0.0, 3.0, 4.0]]], requires_grad=True)
        >>> poses, lens = torch.eye(4)[None, None], torch.tensor([100.0, 100.0, 31.5, 23.5])
        >>> index = torch.tensor([[[[0, -1]]]], dtype=torch.int32)
        >>> depth, uv = torch_gradients.winner_depth(points, poses, lens, index)
        >>> depth.sum().backward()
        >>> depth.flatten().tolist(), uv[0, 0, 0, 0].tolist(), points.grad.flatten().tolist()
        ([5.0, 0.0], [31.5, 98.5], [0.0, 0.6000000238418579, 0.800000011920929])
    """
    check_choice("depth", depth, ("range", "z"))
    given = {"points": points, "poses": poses, "index": index}
    optional = {"intrinsics": intrinsics, "static_map": static_map}
    given.update({name: tensor for name, tensor in optional.items() if tensor is not None})
    _check_tensors(given)
    if intrinsics is not None and intrinsics.ndim == 1 and intrinsics.shape == (4,):
        given["intrinsics"] = intrinsics.expand(*poses.shape[:2], 4).contiguous()
    check_winner_shapes({name: tuple(tensor.shape) for name, tensor in given.items()})
    wp.init()
    static = points.new_zeros((0, 3)) if static_map is None else static_map
    found: tuple[Any, Any] = _WinnerDepth.apply(
        points, static, poses, given.get("intrinsics"), index, depth == "z"
    )
    return found


class _WinnerDepth(torch.autograd.Function):  # type: ignore[misc]
    """The kernel and its adjoint as a node of torch's graph."""

    @staticmethod
    def forward(
        ctx: Any, points: Any, static: Any, poses: Any, intrinsics: Any, index: Any, is_z: bool
    ) -> tuple[Any, Any]:
        ctx.save_for_backward(points, static, poses, intrinsics, index)
        ctx.is_z = is_z
        ctx.set_materialize_grads(False)
        depth = points.new_empty(index.shape)
        uv = None if intrinsics is None else points.new_empty((*index.shape, 2))
        uv_out = None if uv is None else _share(uv, "uv")
        with stream_scope([points], wp.device_from_torch(points.device)):
            inputs = _share_all(points, static, poses, intrinsics)
            run(inputs, _share(index), is_z, _share(depth), uv_out)
        return depth, uv

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, depth_gradient: Any, uv_gradient: Any) -> tuple[Any, ...]:
        *inputs, index = ctx.saved_tensors
        wanted = [
            torch.zeros_like(tensor) if needed else None
            for tensor, needed in zip(inputs, ctx.needs_input_grad[:4], strict=True)
        ]
        with stream_scope([index], wp.device_from_torch(index.device)):
            run_adjoint(
                _share_all(*inputs),
                _share(index),
                ctx.is_z,
                _share_all(*wanted),
                None if depth_gradient is None else _share(depth_gradient.contiguous()),
                None if uv_gradient is None else _share(uv_gradient.contiguous(), "uv"),
            )
        return (*wanted, None, None)


def _share(tensor: Any, what: str | None = None) -> Any:
    """A tensor's memory as a Warp array, of vectors or matrices where `what` names them."""
    dtype = wp.dtype_from_torch(tensor.dtype) if what is None else _VECTORS[tensor.dtype][what]
    return wp.from_torch(tensor.detach(), dtype=dtype, requires_grad=False)


def _share_all(points: Any, static: Any, poses: Any, intrinsics: Any) -> WinnerArrays:
    return WinnerArrays(
        None if points is None else _share(points, "points"),
        None if static is None else _share(static[None], "points"),
        None if poses is None else _share(poses, "poses"),
        None if intrinsics is None else _share(intrinsics, "lens"),
    )


def _check_tensors(given: dict[str, Any]) -> None:
    """Refuse anything but contiguous tensors of one precision on one device."""
    for name, tensor in given.items():
        if not isinstance(tensor, torch.Tensor):
            raise InputError(f"{name} must be a torch tensor, got {type(tensor).__name__}")
    points = given["points"]
    if points.dtype not in _VECTORS:
        raise InputError(f"points must be float32 or float64, got {points.dtype}")
    for name, tensor in given.items():
        dtype = torch.int32 if name == "index" else points.dtype
        if tensor.dtype != dtype:
            raise InputError(f"{name} must be {dtype}, got {tensor.dtype}: .to({dtype})")
        if tensor.device != points.device:
            raise InputError(
                f"{name} must be on {points.device} as the points are, got {tensor.device}: "
                f".to('{points.device}')"
            )
        if not tensor.is_contiguous():
            raise InputError(f"{name} must be contiguous: .contiguous()")
