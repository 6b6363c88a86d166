"""Arrays of Warp, NumPy and DLPack, used where they are."""

from __future__ import annotations

import gc
import weakref
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
import warp as wp

from depthwarp.errors import InputError
from depthwarp.sim.handed import adopt, stream_scope

CPU = wp.get_device("cpu")


class Capsule:
    """An array of a library that knows nothing but DLPack."""

    def __init__(self, array: Any) -> None:
        self.array = array

    def __dlpack__(self, **options: Any) -> Any:
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.array.__dlpack_device__()


def points(shape: tuple[int, ...] = (2, 5, 3)) -> Any:
    return np.arange(np.prod(shape), dtype=np.float32).reshape(shape)


def adopt_points(value: Any, writable: bool = False) -> Any:
    return adopt("points", value, wp.vec3f, (2, None), CPU, writable)


@pytest.mark.parametrize("wrap", [np.asarray, Capsule, lambda a: wp.array(a, device="cpu")])
def test_vectors_of_the_same_memory(wrap: Any) -> None:
    """(2, 5, 3) numbers become (2, 5) vectors at the same address; writing there is seen here."""
    source = wrap(points())
    array = adopt_points(source, writable=True)
    assert array.dtype is wp.vec3f and array.shape == (2, 5) and array.is_contiguous
    np.testing.assert_array_equal(array.numpy(), points())
    array.fill_(7.0)
    seen = getattr(source, "array", source)
    assert (np.asarray(seen.numpy() if isinstance(seen, wp.array) else seen) == 7).all()


def test_an_array_of_the_type_is_itself() -> None:
    """A Warp array that fits is returned, not wrapped."""
    array = wp.zeros((2, 5), dtype=wp.vec3f, device="cpu")
    assert adopt_points(array) is array


@pytest.mark.parametrize(
    ("dtype", "numbers", "shape"),
    [
        (wp.mat44f, np.zeros((3, 2, 4, 4), np.float32), (3, 2)),
        (wp.int32, np.zeros(3, np.int32), (3,)),
        (wp.uint8, np.zeros((3, 2, 4, 4), np.uint8), (3, 2, 4, 4)),
        (wp.float64, np.zeros((3, 1)), (3, 1)),
    ],
)
def test_types(dtype: Any, numbers: Any, shape: Any) -> None:
    """Matrices, counts, states and doubles keep their address."""
    array = adopt("a", numbers, dtype, shape, CPU)
    assert array.ptr == numbers.ctypes.data
    assert array.dtype is dtype and array.shape == shape


def test_the_owner_lives_as_long_as_the_array() -> None:
    """The memory goes when the Warp array goes, and not before."""

    class Numbers(np.ndarray):
        pass

    source: Any = points().view(Numbers)
    owner = weakref.ref(source)
    array = adopt_points(source)
    part = array[1]
    del source, array
    gc.collect()
    assert owner() is not None
    np.testing.assert_array_equal(part.numpy(), points()[1])
    del part
    gc.collect()
    assert owner() is None


@pytest.mark.parametrize("wrap", [np.asarray, lambda a: wp.array(a, device="cpu")])
def test_no_points_at_all(wrap: Any) -> None:
    """An array without any element is no error."""
    assert adopt_points(wrap(points((2, 0, 3)))).shape == (2, 0)


def test_read_only_arrays_are_for_reading() -> None:
    """A read-only NumPy array is taken as an input, and refused as an output."""
    source = points()
    source.flags.writeable = False
    assert adopt_points(source).ptr == source.ctypes.data
    with pytest.raises(InputError, match="points must be writable, got a read-only array"):
        adopt_points(source, writable=True)


def odd_address() -> Any:
    return np.frombuffer(bytearray(121), np.uint8)[1:].view(np.float32).reshape(2, 5, 3)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (points().astype(np.float64), r"float32, got float64: .*points\.astype\(np\.float32\)"),
        (points().astype(">f4"), r"must be float32, got >f4: hand points\.astype"),
        (
            wp.zeros((2, 5), dtype=wp.vec3d, device="cpu"),
            "must be float32, got float64: .*wp.float32",
        ),
        (points((3, 5, 3)), r"must have the shape \(2, any, 3\), got \(3, 5, 3\)"),
        (points((2, 5, 4)), r"must have the shape \(2, any, 3\), got \(2, 5, 4\)"),
        (points((10, 3)), r"must have the shape \(2, any, 3\), got \(10, 3\)"),
        (wp.zeros((3, 5), dtype=wp.vec3f, device="cpu"), r"\(2, any, 3\), got \(3, 5, 3\)"),
        (points((2, 9, 3))[:, ::2], r"contiguous.*np\.ascontiguousarray\(points\)"),
        (odd_address(), r"contiguous.*np\.ascontiguousarray\(points\)"),
        (wp.zeros((2, 9), dtype=wp.vec3f, device="cpu")[:, 2:], r"points\.contiguous\(\)"),
        (Capsule(points((2, 9, 3))[:, ::2]), "contiguous.*a contiguous copy"),
        (points().tolist(), "an array of Warp, torch, JAX, NumPy or with DLPack, got list"),
        (Capsule(np.array(["a"])), "through DLPack"),
    ],
    ids=range(13),
)
def test_refused(value: Any, message: str) -> None:
    """Nothing is copied or converted: the error says what was wrong and what to do."""
    with pytest.raises(InputError, match=message):
        adopt_points(value)


def test_another_device_is_an_error() -> None:
    """A host array for a sensor on CUDA is refused with the call that brings it there."""

    class Cuda:
        alias = "cuda:0"

    with pytest.raises(
        InputError, match=r"on cuda:0.*got cpu: hand wp\.array\(points, dtype=wp\.v"
    ):
        adopt("points", points(), wp.vec3f, (2, None), Cuda())
    with pytest.raises(InputError, match=r'got cpu: hand points\.to\("cuda:0"\)'):
        adopt("points", wp.zeros((2, 5), wp.vec3f, device="cpu"), wp.vec3f, (2, None), Cuda())


def test_no_stream_on_a_cpu() -> None:
    """On a CPU nothing is changed."""
    assert isinstance(stream_scope((points(),), CPU), nullcontext)
