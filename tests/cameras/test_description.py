"""Cameras as plain numbers: through JSON and back, every model."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.cameras.description import MODELS, camera_from_dict, camera_to_dict
from tests.cameras.models import IDENTITY, cameras_of, quietly
from tests.cameras.models import MODELS as RANDOM_MODELS


@pytest.mark.parametrize("model", RANDOM_MODELS)
@settings(max_examples=20)
@given(data=st.data())
def test_a_camera_comes_back_equal(model, data):
    """Written as JSON and read, it is the same camera to the last bit, with the same hash."""
    camera = data.draw(cameras_of(model))
    entries = camera_to_dict(camera)
    text = json.dumps(entries, allow_nan=False)
    again = quietly(camera_from_dict, json.loads(text))
    assert again == camera and hash(again) == hash(camera) and type(again) is type(camera)


@pytest.mark.parametrize("model", RANDOM_MODELS)
def test_other_programs_can_read_it(model):
    """OpenCV's extrinsics for all; K where the model has one."""
    pose = dw.Pose.from_orientation((1, 2, 3), (10, 20, 30))
    camera = RANDOM_MODELS[model](np.random.default_rng(0), pose, 24)
    entries = camera_to_dict(camera)
    assert MODELS[entries["model"]] is type(camera)
    np.testing.assert_array_equal(entries["optical_from_world"], pose.optical_from_world)
    if isinstance(camera, dw.PinholeCamera | dw.FisheyeCamera):
        np.testing.assert_array_equal(entries["K"], camera.K)


def test_every_model_has_a_name():
    """Each public camera class, once."""
    assert len(set(MODELS.values())) == len(MODELS)
    public = {
        value
        for name in dir(dw)
        if isinstance(value := getattr(dw, name), type)
        and issubclass(value, dw.Camera)
        and value is not dw.Camera
    }
    assert public == set(MODELS.values())


def test_an_unknown_model_and_missing_entries_are_refused():
    """The message lists the known names; a missing field is named."""
    entries = camera_to_dict(dw.OrthographicCamera(0.1, 4, 3, IDENTITY))
    with pytest.raises(ValueError, match="unknown camera model 'omni', known are pinhole, fisheye"):
        camera_from_dict(entries | {"model": "omni"})
    for name in ("model", *(field.name for field in dataclasses.fields(dw.OrthographicCamera))):
        with pytest.raises(KeyError, match=name):
            camera_from_dict({key: value for key, value in entries.items() if key != name})
