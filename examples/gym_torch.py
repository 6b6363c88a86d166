"""A vectorized environment in torch: robots that find their way by depth images alone.

Run `python examples/gym_torch.py` (needs torch; with gymnasium it is one of its vector
environments). Each of 32 worlds has a robot in the same scanned room, and a ball that rolls to and
fro. The observation is a torch tensor that shares its memory with the sensor's image: nothing is
copied, on a CPU or on a GPU. A robot is paid for every metre forwards, and its episode ends when
something is nearer than 0.3 m.
"""

from __future__ import annotations

import math
from typing import Any

import warp as wp
from scanned_room import SIZE as ROOM
from scanned_room import scanned_room

import depthwarp as dw

try:
    import torch
except ImportError as error:
    raise SystemExit(f"{error}: pip install torch") from error
try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    gymnasium, VectorEnv = None, object

SIZE, FOV_DEG = (48, 32), (100, 77)
BALL_POINTS, BALL_RADIUS_M = 200, 0.4
STEP_S, SPEED_M_S, MOST_TURN_RAD_S = 0.1, 0.8, 1.5
COLLISION_M, HEIGHT_M = 0.3, 0.6


class RoomEnv(VectorEnv):
    """Robots in rooms; observations, rewards and ends are torch tensors on the sensor's device.

    An action is a turn rate in -1 to 1 for each robot, shape (worlds, 1). A robot whose episode
    has ended is put somewhere else by the step that follows, whatever its action.
    """

    def __init__(self, num_envs: int = 32, device: str = "cpu") -> None:
        self.num_envs, self.device = num_envs, torch.device(device)
        lens = dw.PinholeCamera.from_fov(FOV_DEG, SIZE)
        self._sensor = dw.sim.DepthSensor(
            num_worlds=num_envs,
            cameras_per_world=1,
            size=SIZE,
            model=lens,
            max_points_per_world=BALL_POINTS,
            device=device,
            static_map=scanned_room(30_000).prepare(device=device),
        )
        self._generator = torch.Generator(device)
        self._place = torch.zeros(num_envs, 3, device=device)  # x, y [m], heading [rad]
        self._ended = torch.ones(num_envs, dtype=torch.bool, device=device)
        self._time_s = 0.0
        # What is handed to the sensor; written to, never made anew.
        self._poses = torch.zeros(num_envs, 1, 4, 4, device=device)
        self._poses[..., 1, 2], self._poses[..., 1, 3] = -1.0, HEIGHT_M
        self._poses[..., 3, 3] = 1.0
        self._ball = self._sphere()
        self._points = torch.zeros(num_envs, BALL_POINTS, 3, device=device)
        self._draw()
        self.images = wp.to_torch(self._sensor.step(self._points, self._poses)["depth"])
        if gymnasium is not None:
            self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
            box = gymnasium.spaces.Box
            self.single_observation_space = box(0.0, math.inf, self.images.shape[1:])
            self.single_action_space = box(-1.0, 1.0, (1,))
            self.observation_space = batch_space(self.single_observation_space, num_envs)
            self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Put all robots somewhere."""
        if seed is not None:
            self._generator.manual_seed(seed)
        self._time_s = 0.0
        self._ended[:] = True
        self._begin_again()
        self._ended[:] = False
        self._draw()
        return self.images, {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Drive for 0.1 s; observation, reward, terminated, truncated (never), nothing more."""
        going = ~self._ended
        self._begin_again()
        turn = actions[:, 0].clamp(-1, 1) * (MOST_TURN_RAD_S * STEP_S)
        self._place[:, 2] += torch.where(going, turn, 0)
        heading = self._place[:, 2]
        ahead = torch.stack([heading.cos(), heading.sin()], dim=1) * (SPEED_M_S * STEP_S)
        self._place[:, :2] += torch.where(going[:, None], ahead, 0)
        self._time_s += STEP_S
        self._draw()
        nearest = torch.where(self.images > 0, self.images, math.inf).amin((1, 2, 3))
        torch.logical_and(nearest < COLLISION_M, going, out=self._ended)
        reward = torch.where(going & ~self._ended, SPEED_M_S * STEP_S, 0.0)
        return self.images, reward, self._ended.clone(), torch.zeros_like(self._ended), {}

    def _begin_again(self) -> None:
        """Robots whose episode has ended go to a free place near the middle of the room."""
        share = torch.rand(self.num_envs, 3, generator=self._generator, device=self.device)
        low = torch.tensor([3.2, 2.4, 0.0], device=self.device)
        wide = torch.tensor([1.6, 1.0, 2 * math.pi], device=self.device)
        self._place[:] = torch.where(self._ended[:, None], low + share * wide, self._place)

    def _draw(self) -> None:
        """Write poses and points, and let the sensor draw into its images."""
        cosine, sine = self._place[:, 2].cos(), self._place[:, 2].sin()
        x, y = self._place[:, 0], self._place[:, 1]
        pose = self._poses[:, 0]  # rows: right, down, forward
        pose[:, 0, 0], pose[:, 0, 1], pose[:, 0, 3] = sine, -cosine, cosine * y - sine * x
        pose[:, 2, 0], pose[:, 2, 1], pose[:, 2, 3] = cosine, sine, -cosine * x - sine * y
        phase = torch.arange(self.num_envs, device=self.device) + self._time_s
        self._points[:] = self._ball
        self._points[..., 0] += (ROOM[0] / 2 + 3 * torch.sin(phase))[:, None]
        self._sensor.step(self._points, self._poses)

    def _sphere(self) -> Any:
        """Points spread evenly over a ball on the floor, along a spiral."""
        number = torch.arange(BALL_POINTS, device=self.device) + 0.5
        up = 1 - 2 * number / BALL_POINTS
        flat, turn = (1 - up * up).sqrt(), math.pi * (3 - math.sqrt(5)) * number
        ball = torch.stack([flat * turn.cos(), flat * turn.sin(), up], dim=1) * BALL_RADIUS_M
        return ball + torch.tensor([0.0, 5.0, BALL_RADIUS_M], device=self.device)


def towards_the_farthest(images: Any) -> Any:
    """A policy: turn to where the nearest of a window of 17 columns is farthest away."""
    depth = torch.where(images > 0, images, math.inf)  # 0 is a pixel without a point
    nearest = depth.amin((1, 2))[:, None]
    free = -torch.nn.functional.max_pool1d(-nearest, 17, stride=1)[:, 0]
    middle = free.argmax(dim=1, keepdim=True) + 8
    return 4 * (0.5 - middle / (SIZE[0] - 1))  # to the left is a positive turn


def metres_driven(env: RoomEnv, policy: Any, steps: int) -> tuple[float, int]:
    """What robots are paid in all, and how often one ran into something."""
    images, _ = env.reset(seed=1)
    metres, collisions = 0.0, 0
    for _ in range(steps):
        images, reward, terminated, _, _ = env.step(policy(images))
        metres += float(reward.sum())
        collisions += int(terminated.sum())
    return metres, collisions


def main(steps: int = 150, device: str | None = None) -> dict[str, float]:
    """Drive by the images, and blindly.

    Args:
        steps: How many.
        device: `"cpu"` or `"cuda:0"`; None for a GPU if torch has one.

    Returns:
        Metres between two collisions, with the policy (`seeing`) and straight ahead (`blind`).
    """
    if gymnasium is None:
        print("gymnasium is not installed: the same environment without its base class")
    env = RoomEnv(device=device or ("cuda:0" if torch.cuda.is_available() else "cpu"))
    result = {}
    policies = {"seeing": towards_the_farthest, "blind": lambda images: images[:, 0, 0, :1] * 0}
    for name, policy in policies.items():
        metres, collisions = metres_driven(env, policy, steps)
        result[name] = metres / max(collisions, 1)
        print(
            f"{name}: {env.num_envs} robots drove {metres:.0f} m in {steps * STEP_S:.0f} s each "
            f"and ran into something {collisions} times: {result[name]:.1f} m apart"
        )
    return result


if __name__ == "__main__":
    main()
