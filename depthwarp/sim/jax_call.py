"""The step of a sensor as a function of JAX arrays, for use inside `jax.jit`.

XLA calls the step through its foreign function interface: on XLA's stream, with XLA's own buffers
for arrays and results, so nothing is copied on the way in. Ownership stays with XLA.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from inspect import Parameter, Signature
from threading import Lock
from typing import Any

import warp as wp

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.rendering.ragged import OUTPUTS
from depthwarp.sim.sensor import DepthSensor
from depthwarp_kernels import poses as pose_kernels

__all__ = ["jax_step"]


def jax_step(sensor: DepthSensor) -> Callable[..., dict[str, Any]]:
    """Return the step of a sensor as a function of JAX arrays, for `jit`, `vmap` and `lax.scan`.

    The function is `step(points, poses, counts=None, *, scene_depth=None)`, with the arguments of
    `DepthSensor.step` as JAX arrays: points float32, shape (w, P, 3), or None for the static map
    alone; poses float32, shape (w, C, 4, 4); counts int32, shape (w,); scene_depth float32, shape
    (w, C, height, width). It returns the sensor's outputs by name, new arrays of the shape
    (w, C, height, width).

    Without `vmap`, w is the sensor's number of worlds W. `vmap` folds its axis into the worlds: a
    program of one world (w = 1), mapped over W of them, is one step. Of a multiple of W worlds each
    W are a step, one after the other, and a share that is not whole is an error when the program
    runs. Arguments that are not mapped are repeated for every world.

    Noise differs from step to step, and steps of one program that do not depend on each other may
    run in any order. The step is called anew each time that a program runs and is not recorded in a
    graph of XLA. It has no derivatives: hand `jax.lax.stop_gradient(points)` where a program is
    differentiated, and see `depthwarp.sim.jax_gradients` for derivatives of what it draws.

    Args:
        sensor: On the device on which JAX computes. The function keeps it alive; a compiled
            program alone does not.

    Returns:
        The function. It raises `InputError` while it is traced, for arrays of another type or
        shape; a wrong device or number of worlds is an error of JAX with the same kind of message
        when the program runs.

    Raises:
        MissingExtraError: JAX is not installed.

    Example:
        >>> step = dw.sim.jax_step(sensor)  # doctest: +SKIP
        >>> depth = jax.jit(step)(points, poses)["depth"]  # doctest: +SKIP
    """
    try:
        import jax  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingExtraError("a sensor's step in JAX", "jax", "jax") from error

    calls: dict[tuple[str, ...], Any] = {}
    one_at_a_time = Lock()  # XLA may call from several threads, and a sensor has one set of buffers
    reference = weakref.ref(sensor)

    def call(given: dict[str, Any]) -> dict[str, Any]:
        names = tuple(given)
        if names not in calls:
            calls[names] = _foreign_call(reference, names, one_at_a_time)
        worlds = given["poses"].shape[0]
        shape = (worlds, *_living(reference).shape[1:])
        outputs = _living(reference).outputs
        images = calls[names](*given.values(), output_dims=dict.fromkeys(outputs, shape))
        return dict(zip(outputs, images, strict=True))

    # Without this, a call outside of jit would be compiled anew every time.
    compiled = jax.jit(call)

    def step(
        points: Any, poses: Any, counts: Any = None, *, scene_depth: Any = None
    ) -> dict[str, Any]:
        named = {"points": points, "poses": poses, "counts": counts, "scene_depth": scene_depth}
        given = {name: value for name, value in named.items() if value is not None}
        _check(given, sensor)
        images: dict[str, Any] = compiled(given)
        return images

    return step


def _foreign_call(
    reference: weakref.ref[DepthSensor], names: tuple[str, ...], one_at_a_time: Lock
) -> Any:
    """The step as XLA calls it, with arrays of these names and then one for each output.

    Warp keeps what it registers with XLA for ever: so it is given no more than a weak reference.
    """
    outputs = _living(reference).outputs

    def run(*arrays: Any) -> None:
        sensor = _living(reference)
        given = dict(zip(names, arrays, strict=False))
        results = dict(zip(outputs, arrays[len(names) :], strict=True))
        worlds, total = sensor.shape[0], given["poses"].shape[0]
        if total % worlds:
            raise InputError(
                f"the step was handed {total} worlds, and the sensor has {worlds}: hand as many, "
                "or a multiple, all axes of vmap together"
            )
        for begin in range(0, total, worlds):
            part = slice(begin, begin + worlds)
            inputs = {name: array[part] for name, array in given.items()}
            images = {name: array[part] for name, array in results.items()}
            with one_at_a_time:
                sensor.step(inputs.pop("points", None), **inputs, out=images)

    kinds: dict[str, Any] = {name: _KINDS[name] for name in names}
    kinds |= {name: (OUTPUTS[name], 4) for name in outputs}
    signed: Any = run
    signed.__signature__ = Signature(
        [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in kinds]
    )
    signed.__annotations__ = {
        name: wp.array(dtype=dtype, ndim=ndim) for name, (dtype, ndim) in kinds.items()
    }
    signed.__qualname__ = "depth_sensor_step"  # the name that JAX shows
    signed.__module__ = pose_kernels.__name__  # Warp loads the kernels of a function's module
    return wp.jax_callable(
        signed,
        num_outputs=len(outputs),
        graph_mode=wp.JaxCallableGraphMode.NONE,
        vmap_method="broadcast_all",
    )


_KINDS: dict[str, tuple[Any, int]] = {
    "points": (wp.vec3f, 2),
    "poses": (wp.mat44f, 2),
    "counts": (wp.int32, 1),
    "scene_depth": (wp.float32, 4),
}
"""Type and number of axes of what a step takes, in Warp's terms."""


def _living(reference: weakref.ref[DepthSensor]) -> DepthSensor:
    sensor = reference()
    if sensor is None:
        raise InputError(
            "the sensor of this compiled program is gone: keep the function that jax_step returned"
        )
    return sensor


def _check(given: dict[str, Any], sensor: DepthSensor) -> None:
    """Refuse what could not be drawn whatever axes `vmap` may add."""
    if "poses" not in given:
        raise InputError("poses are missing")
    whole, *image = sensor.shape
    worlds = getattr(given["poses"], "shape", (whole,))[:1] or (whole,)
    if not worlds[0] or (whole % worlds[0] and worlds[0] % whole):
        raise InputError(
            f"poses are those of {worlds[0]} worlds, and the sensor has {whole}: hand as many, or "
            "map over them with vmap"
        )
    wanted: dict[str, tuple[str, tuple[int | None, ...]]] = {
        "points": ("float32", (*worlds, None, 3)),
        "poses": ("float32", (*worlds, image[0], 4, 4)),
        "counts": ("int32", worlds),
        "scene_depth": ("float32", (*worlds, *image)),
    }
    for name, value in given.items():
        dtype, shape = wanted[name]
        if not hasattr(value, "dtype") or not hasattr(value, "shape"):
            raise InputError(f"{name} must be a JAX array, got {type(value).__name__}")
        if str(value.dtype) != dtype:
            raise InputError(
                f"{name} must be {dtype}, got {value.dtype}: hand {name}.astype(jnp.{dtype})"
            )
        sizes = zip(value.shape, shape, strict=False)
        if len(value.shape) != len(shape) or any(size not in (got, None) for got, size in sizes):
            text = ", ".join("any" if size is None else str(size) for size in shape)
            raise InputError(f"{name} must have the shape ({text}), got {tuple(value.shape)}")
