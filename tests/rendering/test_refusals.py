"""Rendering of what cannot be rendered: each error names what was wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.devices import free_memory, resolve_device
from depthwarp.errors import CapacityError, DeviceError, InputError
from depthwarp.rendering.plan import MAP_BYTES
from depthwarp.rendering.splatting import buffer_count


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 0.0), (2.0, 1.0), (-1.0, 5.0), (math.nan, 5.0), (0.0, math.nan), (0.0, -1.0)],
)
def test_bounds_that_are_no_interval_are_refused(low, high):
    """0 <= min_range < max_range; the message gives both."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32))
    with pytest.raises(InputError, match="min_range and max_range"):
        dw.render(cloud, camera, min_range=low, max_range=high, device="cpu")


@pytest.mark.parametrize("bound", ["min_range", "max_range"])
@pytest.mark.parametrize("value", ["a", None, [1.0], True])
def test_bounds_that_are_no_numbers_are_refused(bound, value):
    """The message says which of the two, and what it got."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32))
    with pytest.raises(InputError) as refused:
        dw.render(cloud, camera, device="cpu", **{bound: value})
    assert str(refused.value) == f"{bound} must be a number [m], got {value!r}"


@pytest.mark.parametrize("value", [4, np.float32(4), np.int64(4), np.array(4.0), math.inf])
def test_bounds_of_any_type_of_number(value):
    """Python's, NumPy's, an array of no dimension, infinity."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.array([[2, 0, 0]], np.float32))
    assert dw.render(cloud, camera, max_range=value, device="cpu").depth[1, 1] == 2


def test_an_unknown_depth_kind_is_refused():
    """The message lists the kinds."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(InputError, match="depth must be one of 'range', 'z', got 'euclid'"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), camera, depth="euclid", device="cpu")


def test_arguments_of_another_kind_are_refused():
    """An array is no cloud, a tuple no camera: the message says what to make of it."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(InputError, match=r"PointCloud, got ndarray: dw.PointCloud\(points\)"):
        dw.render(np.zeros((1, 3)), camera, device="cpu")
    with pytest.raises(InputError, match="PinholeCamera or a RangeView, got tuple"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), (1, 2, 3), device="cpu")


@pytest.mark.parametrize("name", ["cuda:99", "tpu", ""])
def test_a_device_that_is_not_there_is_refused(name):
    """The message names it and lists those that there are."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(DeviceError, match=f"device '{name}' is not on this machine.*cpu"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), camera, device=name)


def test_a_map_that_does_not_fit_is_refused(device, monkeypatch):
    """65,000 x 65,000 px with a gigabyte free: what is needed, what is free, what to do."""
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: 10**9)
    camera = dw.PinholeCamera.from_fov((60, 45), (65_000, 65_000))
    cloud = dw.PointCloud(np.zeros((1, 3)))
    with pytest.raises(CapacityError, match=r"65000 x 65000.*1 GB are free.*smaller size"):
        dw.render(cloud, camera, device=device)
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (60, 60), q_depth_map=1e-4, depth_plane=5.0)
    with pytest.raises(CapacityError, match="larger q_depth_map"):
        dw.render(cloud, view, device=device)


def test_filters_count_in_the_memory_of_a_map(device, monkeypatch):
    """A map that just fits does not with the filters' working memory."""
    camera = dw.PinholeCamera.from_fov((60, 45), (100, 100))
    cloud = dw.PointCloud(np.ones((1, 3)))
    buffers = buffer_count(1, resolve_device(device))
    enough = 100 * 100 * (MAP_BYTES + 8 * (buffers - 1) + 3)
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: enough)
    dw.render(cloud, camera, device=device)
    with pytest.raises(CapacityError):
        dw.render(cloud, camera, filters=dw.filters.paper(), device=device)


def test_a_batch_whose_maps_do_not_fit_is_refused(monkeypatch):
    """3 views of 400 x 300 are 3.24 MB of maps: a byte less is refused, nothing is drawn."""
    cameras = [dw.PinholeCamera.from_fov((60, 45), (400, 300))] * 3
    cloud = dw.PointCloud(np.ones((1, 3)))
    drawn: list[object] = []
    monkeypatch.setattr(
        "depthwarp.rendering.batch.draw_looks", lambda looks, *_: drawn.extend(looks) or iter(drawn)
    )
    needed = 3 * 400 * 300 * 9
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: needed - 1)
    message = r"a batch of 3 views needs 0.00324 GB on cpu, .* GB are free: use dw.render_stream"
    with pytest.raises(CapacityError, match=message):
        dw.render_batch(cloud, cameras, device="cpu")
    assert not drawn
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: needed)
    dw.render_batch(cloud, cameras, device="cpu")
    assert len(drawn) == 3


def test_free_memory_is_a_number_of_this_machine(device):
    """More than nothing, less than a petabyte."""
    assert 0 < free_memory(resolve_device(device)) < 10**15
