"""Torch tensors in a sensor's step, used where they are."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.sim import DepthSensor
from depthwarp.sim.handed import adopt, stream_scope

torch: Any = pytest.importorskip("torch")
CPU = wp.get_device("cpu")


def adopt_points(value: Any, device: Any = CPU) -> Any:
    return adopt("points", value, wp.vec3f, (2, None), device)


def test_a_tensor_keeps_its_address() -> None:
    """(2, 5, 3) numbers become (2, 5) vectors of the same memory, views of a tensor too."""
    for tensor in (torch.rand(2, 5, 3), torch.rand(4, 5, 3)[2:]):
        array = adopt_points(tensor)
        assert array.ptr == tensor.data_ptr() and array.shape == (2, 5)
        array.fill_(7.0)
        assert (tensor == 7).all()


def test_a_tensor_with_gradients_is_detached() -> None:
    """Memory is shared, the graph of the gradients is not kept alive."""
    leaf = torch.rand(2, 5, 3, requires_grad=True)
    product = leaf * 2
    address, values, graph = product.data_ptr(), product.detach().clone(), weakref.ref(leaf)
    array = adopt_points(product)
    del leaf, product  # the leaf is held by the graph, if that is still there
    gc.collect()
    assert array.ptr == address and not array.requires_grad and graph() is None
    np.testing.assert_array_equal(array.numpy(), values.numpy())


def test_no_points_at_all() -> None:
    """A tensor without any element is no error."""
    assert adopt_points(torch.zeros(2, 0, 3)).shape == (2, 0)


@pytest.mark.parametrize(
    ("tensor", "message"),
    [
        (
            torch.zeros(2, 5, 3, dtype=torch.float64),
            r"got float64: hand points\.to\(torch\.float32",
        ),
        (torch.zeros(2, 3, 5).transpose(1, 2), r"hand points\.contiguous\(\)"),
        (torch.zeros(2, 5, 3).to_sparse(), r"points\.to_dense\(\)"),
        (torch.zeros(2, 5, 3, device="meta"), r'on cpu.*got meta.*points\.to\("cpu"\)'),
        (torch.zeros(2, 5, 2), r"\(2, any, 3\), got \(2, 5, 2\)"),
    ],
    ids=["type", "gaps", "sparse", "device", "shape"],
)
def test_refused(tensor: Any, message: str) -> None:
    """Nothing is copied or converted: the error says what was wrong and what to do."""
    with pytest.raises(InputError, match=message):
        adopt_points(tensor)


def scene() -> tuple[Any, Any]:
    """Points and poses of two worlds with one camera each."""
    lens = dw.PinholeCamera.from_fov((80, 65), (20, 15))
    points = np.random.default_rng(3).uniform(-5, 5, (2, 200, 3)).astype(np.float32)
    return points, np.tile(lens.pose.optical_from_world.astype(np.float32), (2, 1, 1, 1))


@pytest.fixture(scope="module")
def sensor() -> DepthSensor:
    lens = dw.PinholeCamera.from_fov((80, 65), (20, 15))
    return DepthSensor(2, 1, None, lens, 200, device="cpu", outputs=("depth", "index"))


def test_step_reads_and_writes_tensors(sensor: DepthSensor) -> None:
    """Tensors in and tensors in `out` give the bits of NumPy arrays; a changed tensor is seen."""
    points, poses = scene()
    tensors, looks = torch.tensor(points), torch.tensor(poses)
    out = {
        "depth": torch.empty(sensor.shape),
        "index": torch.empty(sensor.shape, dtype=torch.int32),
    }
    for factor in (1, 0.5):
        tensors *= factor
        points *= factor
        expected = {
            name: array.numpy().copy() for name, array in sensor.step(points, poses).items()
        }
        assert (expected["depth"] > 0).any()
        maps = sensor.step(tensors, looks, out=out)
        for name, tensor in out.items():
            assert maps[name].ptr == tensor.data_ptr()
            np.testing.assert_array_equal(tensor.numpy(), expected[name])


def test_results_become_tensors_without_a_copy(sensor: DepthSensor) -> None:
    """`wp.to_torch` of a result is the sensor's own memory, which the next step overwrites."""
    points, poses = scene()
    depth = wp.to_torch(sensor.step(points, poses)["depth"])
    assert (depth > 0).any()
    sensor.step(points + np.float32(100), poses)
    assert not (depth > 0).any()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device for torch")
def test_on_a_stream_of_torch() -> None:
    """On CUDA a step is queued on torch's current stream, so it sees what was queued before it."""
    lens = dw.PinholeCamera.from_fov((80, 65), (20, 15))
    sensor = DepthSensor(2, 1, None, lens, 200, device="cuda:0")
    points, poses = scene()
    expected = sensor.step(*(torch.tensor(a, device="cuda:0") for a in (points, poses)))
    expected_depth = expected["depth"].numpy().copy()
    tensors, looks = torch.zeros(2, 200, 3, device="cuda:0"), torch.tensor(poses, device="cuda:0")
    stream = torch.cuda.Stream()
    torch.cuda.synchronize()
    with torch.cuda.stream(stream):
        assert isinstance(stream_scope((tensors,), wp.get_device("cuda:0")), wp.ScopedStream)
        torch.cuda._sleep(50_000_000)
        tensors.copy_(torch.tensor(points).pin_memory(), non_blocking=True)
        depth = wp.to_torch(sensor.step(tensors, looks)["depth"]).clone()
    stream.synchronize()
    np.testing.assert_array_equal(depth.cpu().numpy(), expected_depth)
