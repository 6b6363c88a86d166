"""The map that the tests of saving write."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw
from tests.saving.maps import render


@pytest.fixture(scope="package")
def depth_map() -> dw.DepthMap:
    """A map that nobody changes."""
    result = render(min_range=0.5, max_range=8.0)
    assert set(np.unique(result.state)) == set(dw.State)
    return result
