"""The package as a whole: its names, what importing it costs, and that `python -O` changes nothing.

Where a fresh interpreter is needed, a small script runs in one.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp import errors
from depthwarp.devices import resolve_device
from depthwarp.errors import CapacityError, DeviceError
from depthwarp.rendering.plan import MAP_BYTES
from depthwarp.rendering.splatting import buffer_count

ROOT = Path(__file__).resolve().parents[1]
PUBLIC = [
    "Camera",
    "CylindricalCamera",
    "DepthMap",
    "DepthMaps",
    "DoubleSphereCamera",
    "EquirectangularCamera",
    "FisheyeCamera",
    "OrthographicCamera",
    "PinholeCamera",
    "PointCloud",
    "Pose",
    "PreparedCloud",
    "RangeView",
    "RenderStats",
    "Renderer",
    "SpinningLidar",
    "State",
    "cameras",
    "errors",
    "filters",
    "io",
    "read",
    "render",
    "render_batch",
    "render_stream",
    "sim",
]
HEAVY = ["warp", "cv2", "matplotlib", "serial", "typer", "rich", "open3d"]


def run_python(script: str, *flags: str) -> str:
    """Standard output of a script in a fresh interpreter that finds the package."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "kernels"), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path.rstrip(os.pathsep)}
    done = subprocess.run(
        [sys.executable, *flags, "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# --- names ---


def test_the_public_names():
    """The surface, locked: a new name is added here on purpose, none goes by accident."""
    assert dw.__all__ == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_there(name):
    """Each is a class, a function or a module with a docstring, and is found again."""
    value = getattr(dw, name)
    assert value.__doc__ and getattr(dw, name) is value
    assert name in dir(dw)
    if not isinstance(value, types.ModuleType):
        assert value.__module__.startswith("depthwarp.")


def test_names_of_the_submodules():
    """Every `__all__` of the core names what is there."""
    for name in [
        "arrays",
        "cameras",
        "checks",
        "cloud",
        "depth_map",
        "devices",
        "encodings",
        "errors",
        "filters",
        "io",
        "range_view",
        "rendering",
        "saving",
    ]:
        module = importlib.import_module(f"depthwarp.{name}")
        assert [entry for entry in module.__all__ if not hasattr(module, entry)] == []


def test_a_name_that_is_not_there():
    """An AttributeError as of any module; so `hasattr` and `from ... import` work."""
    assert not hasattr(dw, "rasterize")
    with pytest.raises(AttributeError, match="'depthwarp' has no attribute 'rasterize'"):
        dw.rasterize  # noqa: B018
    with pytest.raises(ImportError, match="rasterize"):
        exec("from depthwarp import rasterize")


def test_the_version():
    """A number of three parts."""
    assert [part.isdigit() for part in dw.__version__.split(".")] == [True] * 3


def test_errors_are_what_python_programs_expect():
    """Bad input: ValueError; too little memory: MemoryError; a missing package: ImportError."""
    assert issubclass(errors.InputError, ValueError)
    assert issubclass(errors.FileFormatError, errors.InputError)
    assert issubclass(errors.DeviceError, errors.InputError)
    assert issubclass(errors.CapacityError, errors.InputError)
    assert issubclass(errors.CapacityError, MemoryError)
    assert issubclass(errors.MissingExtraError, ImportError)
    assert issubclass(errors.LensDomainWarning, UserWarning)
    for name in set(errors.__all__) - {"LensDomainWarning"}:
        assert issubclass(getattr(errors, name), errors.DepthwarpError)


# --- imports ---


def test_importing_the_package_is_light():
    """`import depthwarp` loads neither Warp nor OpenCV nor any other heavy package."""
    script = f"import sys, depthwarp; print([m for m in {HEAVY} + ['numpy'] if m in sys.modules])"
    assert run_python(script).strip() == "[]"


def test_plots_and_serial_ports_are_not_imported_by_rendering():
    """A rendering loads Warp, and none of what plots, scans or talks to people."""
    script = f"""
import sys
import numpy as np
import depthwarp as dw
camera = dw.PinholeCamera.from_fov((60, 45), (4, 3))
dw.render(dw.PointCloud(np.ones((1, 3))), camera, device="cpu", filters=dw.filters.paper())
print("loaded:", [m for m in {HEAVY} if m in sys.modules])
"""
    assert run_python(script).splitlines()[-1] == "loaded: ['warp']"


# --- python -O ---

SCRIPT = """
import hashlib, json
import numpy as np
import warp as wp
wp.config.log_level = wp.LOG_ERROR
import depthwarp as dw

rng = np.random.default_rng(0)
points = rng.uniform(-6, 6, (3000, 3)).astype(np.float32)
points[::100] = np.nan
cloud = dw.PointCloud(points)
view = dw.RangeView((0.5, 0.3, 0.1), (0, 10, 30), (60, 60), 0.05, 0.1)
camera = dw.PinholeCamera.from_fov((60, 45), (40, 30))
result = {"debug": __debug__}
for name, maps in {
    "view": dw.render(cloud, view, filters=dw.filters.paper(), device="cpu"),
    "camera": dw.render(cloud, camera, depth="z", device="cpu"),
}.items():
    data = maps.depth.tobytes() + maps.index.tobytes() + maps.state.tobytes()
    result[name] = [hashlib.sha256(data).hexdigest(), dict(maps.stats)]
result["selected"] = int(view.segment(cloud, device="cpu").sum())

def refused(call):
    try:
        call()
    except Exception as error:
        return [type(error).__name__, str(error)]
    return "accepted"

result["errors"] = [refused(call) for call in [
    lambda: dw.PinholeCamera.from_fov((0, 45), (40, 30)),
    lambda: dw.PinholeCamera.from_fov((60, 180), (40, 30)),
    lambda: dw.PinholeCamera.from_fov((60, 45), (10**9, 30)),
    lambda: dw.PinholeCamera.from_matrix(np.eye(4), (40, 30)),
    lambda: dw.Pose.from_optical(2 * np.eye(4)),
    lambda: dw.RangeView((0, 0, 0), (0, 0, 0), (60, 60), q_line=0),
    lambda: dw.RangeView((99, 0, 0), (0, 0, 0), (60, 60)).segment(cloud, device="cpu"),
    lambda: dw.PointCloud(np.zeros((3, 2))),
    lambda: dw.PointCloud(points, {"ring": np.zeros(2)}),
    lambda: dw.render(points, camera),
    lambda: dw.render(cloud, camera, max_range=-1),
    lambda: dw.render(cloud, camera, device="cuda:99"),
    lambda: dw.filters.dilate(side=0),
    lambda: dw.filters.remove_hidden(threshold=float("nan")),
    lambda: dw.render(cloud, camera, device="cpu").save("depth.bmp"),
    lambda: dw.DepthMap.load("none.npz"),
    lambda: dw.read("none.ply"),
]]
print(json.dumps(result))
"""


def test_optimized_python_gives_the_same_results_and_errors():
    """`python -O` drops assert statements: neither a pixel nor a check may depend on one."""
    plain, optimized, more = (
        json.loads(run_python(SCRIPT, *flags).splitlines()[-1]) for flags in ([], ["-O"], ["-OO"])
    )
    assert plain.pop("debug") and not optimized.pop("debug") and not more.pop("debug")
    assert plain == optimized == more
    assert "accepted" not in plain["errors"] and len(plain["errors"]) == 17
    assert not any("Assertion" in kind for kind, _ in plain["errors"])
    assert plain["view"][1]["drawn"] > 100 and plain["selected"] > 100


# --- what this machine does not have ---


@pytest.mark.parametrize("name", ["cuda:99", "gpu", ""])
def test_an_unknown_device_is_an_error_that_lists_the_known_ones(device, name):
    """The message names the device asked for, and those that there are."""
    with pytest.raises(DeviceError, match=f"device '{name}' is not on this machine") as caught:
        resolve_device(name)
    assert "cpu" in str(caught.value) and device in str(caught.value)
    assert resolve_device(device).alias == device


def test_a_map_that_is_larger_than_the_memory_is_an_error(device, monkeypatch):
    """65,000 x 65,000 pixels where 4 GB are free: CapacityError before anything is allocated."""
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: 4 * 10**9)
    camera = dw.PinholeCamera.from_fov((60, 45), (65_000, 65_000))
    cloud = dw.PointCloud(np.ones((1, 3)))
    with pytest.raises(CapacityError) as caught:
        dw.render(cloud, camera, device=device)
    message = str(caught.value)
    needed = 65_000**2 * (MAP_BYTES + 8 * (buffer_count(1, resolve_device(device)) - 1)) / 1e9
    assert "65000 x 65000" in message and f"{needed:.3g} GB" in message
    assert "4 GB are free" in message
    assert "smaller size" in message and device in message
    with pytest.raises(MemoryError):  # for programs that know nothing of depthwarp's errors
        dw.render(cloud, camera, filters=dw.filters.paper(), device=device)
