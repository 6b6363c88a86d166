"""Kernels as CUDA's compiler sees them: no GPU is needed, NVRTC comes with Warp."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from depthwarp_kernels import options, ragged_shared, splat_cuda
from depthwarp_kernels.point_source import PREPARED
from depthwarp_kernels.ragged_shared import MOST_PIXELS
from depthwarp_kernels.sim_compose import compose_kernel
from depthwarp_kernels.splat import COUNT_COLUMNS, splat_kernel
from tests.kernels.compile_families import ROUNDING, ptx_of
from tests.kernels.scenes import CULLED, SCENES, splat_configs

FAMILIES = {
    file.stem
    for file in Path(options.__file__).parent.glob("*.py")
    if "\n@wp.kernel\n" in file.read_text() and file.stem != "resolve_blocks"
}
"""Files with kernels outside factories; `resolve_blocks` is for CPUs alone."""

LIBRARIES = {"laser_color", "twin"}
"""Files with exponentials and sines of CUDA's library: no part of the maps."""


@pytest.fixture(scope="module")
def architecture() -> int:
    """The oldest architecture that the compiler writes PTX for."""
    known = wp.get_cuda_supported_archs()
    if not known:
        pytest.skip("this Warp was built without CUDA's compiler")
    return min(known)


def assert_plain_arithmetic(ptx: str) -> None:
    """float32 that rounds as on a CPU, in registers: no double, nothing fused, no local memory."""
    body = re.sub(r"//.*", "", ptx)
    assert "ret;" in body  # it is the code
    assert ".f64" not in body
    assert ROUNDING.findall(body) == []
    assert "__local_depot" not in body and ".local" not in body


@pytest.mark.parametrize("scene", SCENES)
def test_the_splat_stays_in_registers_and_rounds_as_on_a_cpu(scene, architecture, tmp_path):
    """Every lens, plain and prepared: wide reads, one atomic a point, one a count and warp."""
    for config in splat_configs(scene):
        ptx = ptx_of(splat_cuda.chunk_kernel(config).module, architecture, tmp_path)
        assert_plain_arithmetic(ptx)
        size = splat_cuda.points_of_lane(config)
        reasons = COUNT_COLUMNS - 1  # drawn pixels are counted when they are resolved
        atomics = re.findall(r"\b(?:atom|red)\.global\.(?:\w+\.)*?(min|add)\.", ptx)
        assert sorted(atomics) == ["add"] * reasons + ["min"] * size
        assert len(re.findall(r"\b(?:atom|red)\.", ptx)) == len(atomics)
        wide = 3 if config.source is PREPARED and size == 4 else 0
        assert ptx.count("ld.global.v4.f32") == wide


@pytest.mark.parametrize("scene", CULLED)
def test_listing_chunks_costs_atomics_by_the_warp(scene, architecture, tmp_path):
    """All ways to cull: one atomic for the places in the list, two for the counts."""
    (_, config) = splat_configs(scene)
    ptx = ptx_of(splat_cuda.list_kernel(config).module, architecture, tmp_path)
    assert_plain_arithmetic(ptx)
    # The compiler may write the threads' loop twice.
    assert len(re.findall(r"\b(?:atom|red)\.", ptx)) in (3, 6)


@pytest.mark.parametrize("outputs", [{"depth"}, {"depth", "index", "state"}])
def test_composing_reads_and_writes_what_is_asked_for(outputs, architecture, tmp_path):
    """The other renderer's depth and its own maps; nothing is written but the outputs."""
    ptx = ptx_of(compose_kernel(frozenset(outputs)).module, architecture, tmp_path)
    assert_plain_arithmetic(ptx)
    written = {"depth": "f32", "index": "u32", "state": "u8"}
    stores = set(re.findall(r"\bst\.global\.(\w+)", ptx))
    assert len(stores) == len(outputs) and written["depth"] in stores


@pytest.mark.parametrize("architecture", [80, 90])
@pytest.mark.parametrize(
    ("scene", "outputs", "begins"),
    [
        ("pinhole", {"depth"}, False),
        ("pinhole", {"depth", "index", "state"}, True),
        ("moving", {"depth", "index", "state"}, False),
    ],
)
def test_small_images_stay_in_shared_memory(scene, outputs, begins, architecture, tmp_path):
    """The largest of them: one atomic a point and one a count, none of them on global memory."""
    if architecture not in wp.get_cuda_supported_archs():
        pytest.skip(f"this Warp's compiler does not write code for sm_{architecture}")
    splat_config = splat_configs(scene)[0]
    key = wp.uint64 if "index" in outputs else wp.uint32
    config = ragged_shared.shared_config(splat_config, frozenset(outputs), MOST_PIXELS[key], begins)
    ptx = ptx_of(ragged_shared.shared_kernel(config).module, architecture, tmp_path)
    assert_plain_arithmetic(ptx)
    width = 64 if key is wp.uint64 else 32
    size = ragged_shared.points_of_thread(splat_config)
    expected = ["add.u32"] * COUNT_COLUMNS + [f"min.u{width}"] * size
    assert sorted(re.findall(r"\b(?:atom|red)\.shared\.(\S+)", ptx)) == expected
    assert len(re.findall(r"\b(?:atom|red)\.", ptx)) == len(expected)
    # All that a block gets without being asked, and no byte more.
    assert sum(map(int, re.findall(r"^\s*\.shared .*\[(\d+)\]", ptx, re.MULTILINE))) == 48 * 1024


def test_single_points_compile(architecture, tmp_path):
    """The kernel that tests compare with on a GPU."""
    (config, _) = splat_configs("pinhole")
    assert_plain_arithmetic(ptx_of(splat_kernel(config).module, architecture, tmp_path))


def test_every_other_kernel_compiles(architecture):
    """Filters, poses, laser line, twin and all else; what makes maps rounds as on a CPU."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.kernels.compile_families", str(architecture)],
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    rounding = {name: int(count) for name, count in map(str.split, done.stdout.splitlines())}
    assert len(FAMILIES) > 20 and rounding.keys() >= FAMILIES
    assert {name for name, count in rounding.items() if count} <= LIBRARIES
