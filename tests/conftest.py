"""What all tests share: signals, devices, the pace of hypothesis, the folder of real scans."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import warp as wp
from hypothesis import HealthCheck, settings

wp.config.log_level = wp.LOG_WARNING
wp.init()

# A shell that starts the tests in the background lets them ignore Ctrl-C and Ctrl-backslash, and so
# would do the programs that are ended by them here.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGQUIT") and signal.getsignal(signal.SIGQUIT) is signal.SIG_IGN:
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)

DEVICES = ["cpu", *(device.alias for device in wp.get_cuda_devices())]

COMMON = {
    "deadline": None,  # the first call of a kernel compiles it
    "derandomize": bool(os.environ.get("CI")),
    "suppress_health_check": [HealthCheck.too_slow],
}
settings.register_profile("quick", max_examples=80, **COMMON)
settings.register_profile("thorough", max_examples=1500, **COMMON)  # --hypothesis-profile=thorough
settings.load_profile("quick")


@pytest.fixture(scope="session", params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Every device of this machine, one after the other: the CPU and each CUDA device."""
    name: str = request.param
    return name


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real scans beside the project; a test that asks for it skips without it."""
    folder = Path(__file__).resolve().parents[1].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real scans on this machine: there is no folder {folder}")
    return folder
