"""The examples of simulation loops run, and what they print is so."""

from __future__ import annotations

import numpy as np
import pytest


def test_the_room_is_what_its_boxes_say(example):
    """Points lie on faces of the boxes and nowhere else, the same with every call."""
    module = example("scanned_room")
    points = module.scanned_room(1000).points_world
    low, high = np.array(module.BOXES).transpose(1, 0, 2)
    on_face = (np.abs(points[:, None] - low) < 1e-6) | (np.abs(points[:, None] - high) < 1e-6)
    inside = ((points[:, None] > low - 1e-6) & (points[:, None] < high + 1e-6)).all(axis=2)
    assert (on_face.any(axis=2) & inside).any(axis=1).all()
    assert (inside & on_face.any(axis=2)).any(axis=0).all()  # each box has some
    np.testing.assert_array_equal(points, module.scanned_room(1000).points_world)


def test_a_warp_loop(example, capsys):
    """The replayed graph draws what calls draw, and the person is seen."""
    result = example("warp_loop").main(steps=20, device="cpu")
    assert result["differ"] == 0 and 0.005 < result["person"] < 0.2
    assert result["calls"] > 0 and result["replays"] > 0
    text = capsys.readouterr().out
    assert "0 pixels differ" in text and "nothing went wrong" in text


def test_a_vectorized_environment(example, capsys):
    """Robots that look drive farther between two collisions than those that do not."""
    pytest.importorskip("torch")
    result = example("gym_torch").main(steps=60, device="cpu")
    assert result["seeing"] > 1.5 * result["blind"] > 0
    assert "seeing: 32 robots" in capsys.readouterr().out


def test_the_first_step_begins_where_the_reset_ended(example):
    """Straight on: each robot is a step further along its heading, none is put elsewhere."""
    torch = pytest.importorskip("torch")
    module = example("gym_torch")
    robots = module.RoomEnv(8)
    robots.reset(seed=1)
    before = robots._place.clone()
    robots.step(torch.zeros(8, 1))
    way = module.SPEED_M_S * module.STEP_S
    ahead = torch.stack([before[:, 2].cos(), before[:, 2].sin(), 0 * before[:, 2]], dim=1)
    torch.testing.assert_close(robots._place, before + way * ahead)


def test_observations_are_the_image_itself(example):
    """A step writes into the tensor that was handed out; an ended episode begins anew."""
    torch = pytest.importorskip("torch")
    module = example("gym_torch")
    env = module.RoomEnv(4)
    images, _ = env.reset(seed=3)
    before, address = images.clone(), images.data_ptr()
    ahead = torch.zeros(4, 1)
    ends = []
    for _ in range(120):
        images, reward, terminated, truncated, _ = env.step(ahead)
        ends.append(terminated)
        assert (reward[terminated] == 0).all() and not truncated.any()
    assert images.data_ptr() == address and not torch.equal(images, before)
    ended = torch.stack(ends)
    assert ended.any(dim=0).all() and not (ended[1:] & ended[:-1]).any()


def test_the_environment_is_one_of_gymnasium(example):
    """With gymnasium it is its `VectorEnv`, and what it returns is of its spaces' shapes."""
    pytest.importorskip("torch")
    vector = pytest.importorskip("gymnasium.vector")
    env = example("gym_torch").RoomEnv(3)
    images, _ = env.reset(seed=0)
    assert isinstance(env, vector.VectorEnv)
    assert tuple(images.shape) == env.observation_space.shape == (3, 1, 32, 48)
    assert env.action_space.shape == (3, 1)


def test_a_jax_rollout(example, capsys):
    """Robots drive most of the way, and each sees its own trolley."""
    pytest.importorskip("jax")
    result = example("jax_rollout").main(steps=20, device="cpu")
    assert 0.6 * 1.2 < result["metres"] <= 1.2 + 1e-4
    assert 0.005 < result["trolley"] < 0.05
    assert "nothing went wrong" in capsys.readouterr().out


def test_mujoco_in_a_scanned_room(example, capsys):
    """Robot and room are in one image, each by its own renderer."""
    pytest.importorskip("mujoco_warp")
    result = example("mujoco_room").main(steps=5, device="cpu")
    assert result["robot"] > 0.01 and result["room"] > 0.5 and result["is_clean"]
    assert "images/s" in capsys.readouterr().out
