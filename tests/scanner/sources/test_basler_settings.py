"""Exposure, gain and features of a Basler camera, on the SDK's emulated one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.sources import basler
from tests.scanner.sources.conftest import WIDTH, Open


def test_exposure_and_gain_are_in_the_next_frame(camera: Open) -> None:
    """Values that the camera rounds are told as it has them; NaN leaves a setting."""
    nan = float("nan")
    with camera() as source:
        source.configure(2000.04, 3.0)
        frame = source.grab(2.0)
        assert frame.exposure_us == pytest.approx(2000.0, abs=0.1)
        assert frame.gain_db == pytest.approx(3.0, abs=1e-4)
        source.configure(nan, 6.0)
        source.configure(500.0, nan)
        frame = source.grab(2.0)
        assert (frame.exposure_us, round(frame.gain_db, 3)) == (500.0, 6.0)


def test_automatic_exposure_is_switched_off(camera: Open) -> None:
    """Whatever the program before left: the exposure is the one that was set."""
    left = {"ExposureAuto": "Continuous", "GainAuto": "Once", "ExposureMode": "TriggerWidth"}
    with camera(features=left) as source:
        nodes = source._camera.GetNodeMap()
        assert [nodes.GetNode(name).GetValue() for name in left] == ["Off", "Off", "Timed"]


@pytest.mark.parametrize(
    ("exposure_us", "gain_db", "message"),
    [
        (0.5, 0.0, r"exposure_us must be from 1 to 1e\+07 .*0815-0000.*, got 0.5"),
        (float("inf"), 0.0, "exposure_us must be from 1 to"),
        (2000.0, 48.5, "gain_db must be from 0 to 48 .*, got 48.5"),
        (2000.0, -1.0, "gain_db must be from 0 to 48"),
    ],
)
def test_out_of_range_settings_are_refused(
    camera: Open, exposure_us: float, gain_db: float, message: str
) -> None:
    """The message says the camera's range; neither setting is changed."""
    with camera() as source:
        source.configure(700.0, 2.0)
        with pytest.raises(InputError, match=message):
            source.configure(exposure_us, gain_db)
        frame = source.grab(2.0)
        assert (frame.exposure_us, round(frame.gain_db, 3)) == (700.0, 2.0)


def test_older_cameras_have_other_names(camera: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    """`ExposureTimeAbs` is set alike; a gain without a unit can only be the lowest, and is NaN."""
    monkeypatch.setattr(basler, "EXPOSURE_NAMES", ("NoSuchName", "ExposureTimeAbs"))
    monkeypatch.setattr(basler, "GAIN_NAMES", ("NoSuchName", "GainRaw"))
    with camera(features={"GainRaw": 500}) as source:
        source.configure(1500.0, float("nan"))
        assert source._gain.value == 500
        source.configure(1500.0, 0.0)
        frame = source.grab(2.0)
        assert frame.exposure_us == 1500.0
        assert np.isnan(frame.gain_db)
        assert source._gain.value == 192
        with pytest.raises(InputError, match="exposure_us must be from 100 to"):
            source.configure(50.0, 0.0)
        with pytest.raises(InputError, match=r"gain_db must be 0 \(the lowest\)"):
            source.configure(1500.0, 6.0)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({"Width": 99999}, "99999 for its feature 'Width': .*smaller than or equal|99999"),
        ({"Wdith": 100}, "does not take 100 for its feature 'Wdith': .*not available"),
        ({"Width": "wide"}, "'wide' for its feature 'Width': wrong type"),
    ],
)
def test_features_that_the_camera_does_not_take_are_refused(
    camera: Open, features: dict[str, Any], message: str
) -> None:
    """The message names feature and value; the camera is given back."""
    source = camera(features=features)
    with pytest.raises(InputError, match=message):
        source.open()
    assert source._camera is None


def test_settings_are_a_text_that_the_sdk_reads_back(camera: Open, pylon: Any) -> None:
    """They hold the size that was set, and load into a camera of the same model."""
    with camera() as source:
        text = source.settings()
        assert f"\nWidth\t{WIDTH}\n" in text
    with camera() as source:
        source._camera.StopGrabbing()
        pylon.FeaturePersistence.LoadFromString(text, source._camera.GetNodeMap(), True)
