"""Compile every kernel that CUDA runs beside the splat to PTX, in a process of its own.

Run `python -m tests.kernels.compile_families ARCHITECTURE`; it prints one line a module: its name
and how many of its instructions round otherwise than a CPU. Without the compiler's slower passes,
which change no error and no rounding and cost the laser line's kernels 20 s: a setting of the whole
process, which must not reach the kernels of other tests.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import warp as wp

import depthwarp_kernels
from depthwarp_kernels import filters, segment

ROUNDING = re.compile(r"\bfma\.|\.approx|\.ftz|\bmad\.\S*f32")
"""Instructions that round otherwise than a CPU, or take small numbers for zero."""


def modules() -> dict[str, Any]:
    """Warp's modules by name: the kernel files, and those of each factory."""
    found: dict[str, Any] = {}
    for file in pkgutil.iter_modules(depthwarp_kernels.__path__):
        module = wp.get_module(importlib.import_module(f"depthwarp_kernels.{file.name}").__name__)
        if module.kernels:
            found[file.name] = module
    for nearest in (False, True):
        for number, kernel in enumerate(filters.dilate_kernels(nearest)):
            found[f"dilate_{nearest}_{number}"] = kernel.module
    for dtype in (wp.float32, wp.float64):
        found[f"segment_{dtype.__name__}"] = segment.segment_kernel(dtype).module
    return found


def ptx_of(module: Any, architecture: int, folder: Path) -> str:
    """A module as PTX, without the constants of Warp's headers, which no kernel need use."""
    paths = wp.compile_aot_module(module, arch=architecture, module_dir=folder, use_ptx=True)
    (path,) = [path for path in paths if path.suffix == ".ptx"]
    return re.sub(r"^\.global .*$", "", path.read_bytes().decode("latin-1"), flags=re.MULTILINE)


def main(architecture: int) -> None:
    """Compile them one after the other; the first error ends it."""
    wp.config.optimization_level = 1
    wp.config.log_level = wp.LOG_WARNING
    with tempfile.TemporaryDirectory() as folder:
        for name, module in modules().items():
            ptx = ptx_of(module, architecture, Path(folder))
            print(name, len(ROUNDING.findall(ptx)), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
