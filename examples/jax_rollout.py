"""A rollout in JAX: a robot is written once, `vmap` makes many of it, `lax.scan` lets them drive.

Run `python examples/jax_rollout.py` (needs jax). 32 robots drive through a scanned room and turn
to where they see the most room; on their way each pushes a trolley, whose points are its world's
own. The whole rollout is one compiled program of XLA, which calls the sensor on its own stream and
with its own buffers.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scanned_room import scanned_room

import depthwarp as dw

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    raise SystemExit(f"{error}: pip install jax") from error

WORLDS, SIZE, FOV_DEG = 32, (48, 32), (100, 77)
STEP_S, SPEED_M_S, MOST_TURN_RAD_S, HEIGHT_M = 0.1, 0.6, 1.5, 0.8
COLLISION_M = 0.25
MAP_POINTS = 30_000


def pose_of(place: Any) -> Any:
    """World to optical axes of a camera at x, y [m], heading [rad], shape (4, 4)."""
    x, y, heading = place
    cosine, sine = jnp.cos(heading), jnp.sin(heading)
    return jnp.array(
        [
            [sine, -cosine, 0, cosine * y - sine * x],
            [0, 0, -1, HEIGHT_M],
            [cosine, sine, 0, -cosine * x - sine * y],
            [0, 0, 0, 1],
        ],
        jnp.float32,
    )


def trolley_of(place: Any) -> Any:
    """Points of the bar that a robot pushes 0.5 m ahead, 0.4 m wide, shape (50, 3)."""
    x, y, heading = place
    ahead = jnp.array([jnp.cos(heading), jnp.sin(heading)])
    across = jnp.linspace(-0.2, 0.2, 50)[:, None] * jnp.array([-ahead[1], ahead[0]])
    bar = jnp.array([x, y]) + 0.5 * ahead + across
    return jnp.concatenate([bar, jnp.full((50, 1), 0.45)], axis=1)


def turn_rate(image: Any) -> Any:
    """Turn to the side on which the nearest thing above the trolley is farther away."""
    depth = jnp.where(image > 0, image, jnp.inf)[: SIZE[1] // 2]
    left, right = depth[:, : SIZE[0] // 2].min(), depth[:, SIZE[0] // 2 :].min()
    return MOST_TURN_RAD_S * jnp.tanh(2 * (left - right))


def rollout(see: Any, places: Any, steps: int) -> Any:
    """Drive all robots for so many steps.

    Args:
        see: The sensor's step.
        places: x, y [m] and heading [rad] of each robot, shape (W, 3).
        steps: How many.

    Returns:
        Their last places; and of each step, shape (steps, W): metres driven, and the share of
        pixels that see the trolley.
    """

    def one_robot(place: Any) -> Any:
        images = see(trolley_of(place)[None], pose_of(place)[None, None])
        depth, index = images["depth"][0, 0], images["index"][0, 0]
        heading = place[2] + STEP_S * turn_rate(depth)
        nearest = jnp.where(depth > 0, depth, jnp.inf)[: SIZE[1] // 2].min()
        driven = jnp.where(nearest > COLLISION_M, SPEED_M_S * STEP_S, 0.0)
        ahead = jnp.array([jnp.cos(heading), jnp.sin(heading)])
        moved = jnp.concatenate([place[:2] + driven * ahead, heading[None]])
        return moved, (driven, (index >= MAP_POINTS).mean())

    return jax.lax.scan(lambda now, _: jax.vmap(one_robot)(now), places, None, length=steps)


def main(steps: int = 100, device: str | None = None) -> dict[str, float]:
    """Drive for so many steps.

    Args:
        steps: How many.
        device: Warp device; None for the one on which JAX computes.

    Returns:
        Images a second, metres that a robot drove on average, and the share of pixels that saw a
        trolley.
    """
    where = device or ("cuda:0" if jax.default_backend() == "gpu" else "cpu")
    sensor = dw.sim.DepthSensor(
        WORLDS,
        1,
        SIZE,
        dw.PinholeCamera.from_fov(FOV_DEG, SIZE),
        max_points_per_world=50,
        device=where,
        outputs=("depth", "index"),
        static_map=scanned_room(MAP_POINTS).prepare(device=where),
    )
    see = dw.sim.jax_step(sensor)
    rng = np.random.default_rng(0)
    places = jnp.array(rng.uniform([3.2, 2.4, 0], [4.8, 3.4, 6.28], (WORLDS, 3)), jnp.float32)

    program = jax.jit(lambda begin: rollout(see, begin, steps))
    jax.block_until_ready(program(places))  # compiles
    begin = time.perf_counter()
    _, (driven, trolley) = jax.block_until_ready(program(places))
    rate = WORLDS * steps / (time.perf_counter() - begin)
    metres, seen = float(driven.sum(axis=0).mean()), float(trolley.mean())
    print(f"{WORLDS} robots, {SIZE[0]} x {SIZE[1]} px, {steps} steps on {where}: one program")
    print(f"{rate:,.0f} images/s; {sensor.status()}")
    print(f"a robot drove {metres:.1f} m of {steps * STEP_S * SPEED_M_S:.1f}")
    print(f"the trolley fills {seen:.1%} of the images")
    return {"rate": rate, "metres": metres, "trolley": seen}


if __name__ == "__main__":
    main()
