"""Arrays of Warp, torch, JAX, NumPy and DLPack, used where they are.

Ownership: what `adopt` returns aliases the memory of the array that was handed in and holds a
reference to it, so that memory lives for as long as the Warp array does. A step lets go of its
inputs when it returns, of its poses with the next step. On CUDA it may not be done by then: tensors
of torch may be dropped all the same, as torch reuses memory in the order of its stream, but keep
arrays of JAX and other libraries until the results were read. A graph that was captured holds
addresses alone: keep its arrays.

Streams: a step is queued on one stream of its CUDA device: torch's current stream where any of its
arrays is a torch tensor (`stream_scope`), XLA's stream inside `jax.jit`, and else Warp's current
stream of the device. Work that is queued there afterwards sees the results without any waiting on
the host. On a CPU a step is done when the call returns.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from depthwarp.errors import InputError

__all__ = ["adopt", "stream_scope"]


class _Handed(NamedTuple):
    """An array of any library, as plain facts.

    Attributes:
        pointer: Address of the first element.
        dtype: Name of the type of its numbers, such as `"float32"`.
        shape: Its shape, with the numbers of a vector or matrix as the last axes.
        device: Name of its device, as Warp names it.
        is_dense: Whether its numbers stand row by row without gaps.
        is_writable: Whether it may be written to.
        owner: What keeps the memory alive.
        library: Whose array it is: `"torch"`, `"numpy"`, `"jax"`, `"warp"` or `"dlpack"`.
    """

    pointer: int
    dtype: str
    shape: tuple[int, ...]
    device: str
    is_dense: bool
    is_writable: bool
    owner: Any
    library: str


def adopt(
    name: str,
    value: Any,
    dtype: Any,
    shape: tuple[int | None, ...],
    device: Any,
    writable: bool = False,
) -> Any:
    """Return an array of another library as a Warp array of the same memory.

    Nothing is copied, converted or waited for, except that an array of JAX on a CPU is waited for
    until it is computed. The result holds a reference to the array that was handed in; of a torch
    tensor with gradients that is the detached tensor.

    Args:
        name: What the array is called in messages.
        value: `wp.array`, torch tensor, JAX array, anything with DLPack; on a CPU also NumPy.
        dtype: Warp type of the result. A vector or matrix takes up the last axes: `wp.vec3f` is
            made of float32 of the shape (..., 3), `wp.mat44f` of (..., 4, 4).
        shape: Shape of the result; None stands for any size.
        device: Warp device on which it must be.
        writable: Whether the array will be written to.

    Returns:
        Contiguous `wp.array` of the type, shape and device.

    Raises:
        InputError: Another type, shape or device, gaps between the numbers, something that is not
            an array, or one that may not be written to and should be.
    """
    if (
        isinstance(value, wp.array)
        and value.dtype is dtype
        and value.device is device
        and value.is_contiguous
        and _fits(value.shape, shape)
    ):
        return value
    inner = getattr(dtype, "_shape_", ())
    scalar = getattr(dtype, "_wp_scalar_type_", dtype).__name__
    handed = _look_at(name, value)
    _check_device(name, handed, device, dtype)
    _check_type(name, handed, scalar)
    if not _fits(handed.shape, (*shape, *inner)):
        wanted = ", ".join("any" if size is None else str(size) for size in (*shape, *inner))
        raise InputError(f"{name} must have the shape ({wanted}), got {handed.shape}")
    if not handed.is_dense:
        raise InputError(
            f"{name} must be contiguous, row by row without gaps: hand {_dense(name, handed)}"
        )
    if writable and not handed.is_writable:
        raise InputError(_not_writable(name, handed))
    array: Any = wp.array(
        ptr=handed.pointer,
        dtype=dtype,
        shape=handed.shape[: len(shape)],
        device=device,
    )
    array._owner = handed.owner  # Warp arrays of a foreign address own nothing themselves
    return array


def stream_scope(values: Iterable[Any], device: Any) -> AbstractContextManager[Any]:
    """Return a context in which launches go to torch's current stream, if a tensor is on CUDA.

    Torch's stream first waits for Warp's current one, and that one in the end for torch's, both on
    the device, so either may be used afterwards. While torch captures a graph there is no such
    waiting, as the other stream is no part of that graph.

    Args:
        values: Arrays of any library; of no concern on a CPU.
        device: Warp device of the launches.

    Returns:
        A context manager; one that does nothing if no value is a torch tensor on CUDA.
    """
    torch = sys.modules.get("torch")
    if not device.is_cuda or torch is None:
        return nullcontext()
    for value in values:
        if isinstance(value, torch.Tensor) and value.is_cuda:
            stream = wp.stream_from_torch(torch.cuda.current_stream(value.device))
            joins = not stream.is_capturing
            scope: AbstractContextManager[Any] = wp.ScopedStream(stream, joins, joins)
            return scope
    return nullcontext()


def _look_at(name: str, value: Any) -> _Handed:
    # A library that nobody imported has made none of the arrays here.
    torch, jax = sys.modules.get("torch"), sys.modules.get("jax")
    if torch is not None and isinstance(value, torch.Tensor):
        return _look_at_torch(name, value, torch)
    if isinstance(value, np.ndarray):
        return _look_at_numpy(value)
    if isinstance(value, wp.array):
        return _look_at_warp(value, value, "warp", is_writable=True)
    if jax is not None and isinstance(value, jax.Array):
        return _look_at_jax(name, value, jax)
    if hasattr(value, "__dlpack__"):
        return _look_at_warp(_from_dlpack(name, value), value, "dlpack", is_writable=True)
    raise InputError(
        f"{name} must be an array of Warp, torch, JAX, NumPy or with DLPack, got "
        f"{type(value).__name__}"
    )


def _look_at_torch(name: str, tensor: Any, torch: Any) -> _Handed:
    if tensor.layout is not torch.strided:
        raise InputError(f"{name} must be a dense tensor, got {tensor.layout}: {name}.to_dense()")
    device = tensor.device
    return _Handed(
        pointer=tensor.data_ptr(),
        dtype=str(tensor.dtype)[len("torch.") :],
        shape=tuple(tensor.shape),
        device="cpu" if device.type == "cpu" else f"{device.type}:{device.index}",
        is_dense=tensor.is_contiguous(),
        is_writable=True,
        # The tensor itself would keep the graph of its gradients alive too.
        owner=tensor.detach() if tensor.requires_grad else tensor,
        library="torch",
    )


def _look_at_numpy(array: Any) -> _Handed:
    flags = array.flags
    return _Handed(
        pointer=array.__array_interface__["data"][0],
        dtype=_name_of(array.dtype),
        shape=array.shape,
        device="cpu",
        is_dense=flags.c_contiguous and flags.aligned,
        is_writable=flags.writeable,
        owner=array,
        library="numpy",
    )


@cache
def _name_of(dtype: Any) -> str:
    """The name of a NumPy type, which NumPy puts together anew each time that it is asked."""
    return str(dtype.name if dtype.isnative else dtype.str)


def _look_at_jax(name: str, array: Any, jax: Any) -> _Handed:
    if isinstance(array, jax.core.Tracer):
        raise InputError(
            f"{name} has no values while JAX traces a function: inside jax.jit use dw.sim.jax_step"
        )
    if len(array.sharding.device_set) > 1:
        raise InputError(
            f"{name} is spread over {len(array.sharding.device_set)} devices of JAX: "
            f"bring it to one, jax.device_put({name}, jax.devices()[0])"
        )
    return _look_at_warp(_from_dlpack(name, array), array, "jax", is_writable=False)


def _look_at_warp(array: Any, source: Any, library: str, *, is_writable: bool) -> _Handed:
    """A Warp array as it is, or one that stands for an array of another library."""
    return _Handed(
        pointer=array.ptr,
        dtype=getattr(array.dtype, "_wp_scalar_type_", array.dtype).__name__,
        shape=(*array.shape, *getattr(array.dtype, "_shape_", ())),
        device=array.device.alias,
        is_dense=array.is_contiguous,
        is_writable=is_writable,
        owner=(array, source),
        library=library,
    )


def _from_dlpack(name: str, value: Any) -> Any:
    try:
        return wp.from_dlpack(value)
    except (BufferError, RuntimeError, TypeError, ValueError) as error:
        raise InputError(f"{name} cannot be used where it is, through DLPack: {error}") from error


def _check_device(name: str, handed: _Handed, device: Any, dtype: Any) -> None:
    if handed.device == device.alias:
        return
    remedy = {
        "torch": f'{name}.to("{device.alias}")',
        "numpy": f'wp.array({name}, dtype=wp.{dtype.__name__}, device="{device.alias}")',
        "jax": f'jax.device_put({name}, wp.device_to_jax("{device.alias}"))',
        "warp": f'{name}.to("{device.alias}")',
        "dlpack": "an array of that device",
    }[handed.library]
    raise InputError(
        f"{name} must be on {device.alias}, the sensor's device, got {handed.device}: hand {remedy}"
    )


def _check_type(name: str, handed: _Handed, scalar: str) -> None:
    if handed.dtype == scalar:
        return
    remedy = {
        "torch": f"{name}.to(torch.{scalar})",
        "numpy": f"{name}.astype(np.{scalar})",
        "jax": f"{name}.astype(jnp.{scalar})",
        "warp": f"an array made with wp.{scalar}",
        "dlpack": f"an array of {scalar}",
    }[handed.library]
    raise InputError(f"{name} must be {scalar}, got {handed.dtype}: hand {remedy}")


def _dense(name: str, handed: _Handed) -> str:
    """How a caller makes an array contiguous."""
    if handed.library in ("torch", "warp"):
        return f"{name}.contiguous()"
    return f"np.ascontiguousarray({name})" if handed.library == "numpy" else "a contiguous copy"


def _not_writable(name: str, handed: _Handed) -> str:
    if handed.library == "jax":
        return f"{name} is an array of JAX, which never change: use dw.sim.jax_step"
    return f"{name} must be writable, got a read-only array"


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if len(shape) != len(wanted):
        return False
    for size, expected in zip(shape, wanted, strict=True):
        if expected is not None and size != expected:
            return False
    return True
