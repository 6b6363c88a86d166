"""A plain Warp loop: robots drive through a scanned room in which a person walks.

Run `python examples/warp_loop.py`. Each of 16 worlds has a robot with a depth camera, and a person
whose points move; the room is one map that all worlds share. Driving, walking and the cameras are
one graph that is captured once and replayed, on a GPU and on a CPU alike: no memory is allocated,
nothing is compiled and nobody waits between two steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import warp as wp
from scanned_room import scanned_room

import depthwarp as dw

WORLDS, PERSON_POINTS, SIZE = 16, 500, (64, 48)
STEP_S = 0.05


# Robots drive in circles, each a bit further on than the one of the world before. The rows of a
# rotation are the camera's right, down and forward axes in the world.
@wp.kernel
def drive(step: wp.array[wp.int32], poses_out: wp.array2d[wp.mat44f]):
    """Where each robot's camera is at this step."""
    world = wp.tid()
    angle = 0.3 * wp.static(STEP_S) * float(step[0]) + 0.4 * float(world)
    position = wp.vec3f(4.0 + 1.9 * wp.cos(angle), 3.0 + 1.9 * wp.sin(angle), 1.2)
    forward = wp.vec3f(-wp.sin(angle), wp.cos(angle), 0.0)
    right = wp.vec3f(forward[1], -forward[0], 0.0)
    down = wp.vec3f(0.0, 0.0, -1.0)
    poses_out[world, 0] = wp.mat44f(
        right[0], right[1], right[2], -wp.dot(right, position),
        down[0], down[1], down[2], -wp.dot(down, position),
        forward[0], forward[1], forward[2], -wp.dot(forward, position),
        0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


# A person is a cylinder of points, 0.5 m wide and 1.8 m high, that walks to and fro.
@wp.kernel
def walk(step: wp.array[wp.int32], points_out: wp.array2d[wp.vec3f]):
    """Where the points of each person are at this step."""
    world, point = wp.tid()
    time_s = wp.static(STEP_S) * float(step[0])
    around = 2.399963 * float(point)  # the golden angle: points spread evenly
    middle = wp.vec3f(3.2 + 1.5 * wp.sin(0.7 * time_s + float(world)), 4.6, 0.0)
    height = 1.8 * (float(point) + 0.5) / float(points_out.shape[1])
    points_out[world, point] = middle + wp.vec3f(
        0.25 * wp.cos(around), 0.25 * wp.sin(around), height
    )


@wp.kernel
def count_up(step_out: wp.array[wp.int32]):
    """The time goes on."""
    step_out[0] = step_out[0] + 1


def main(steps: int = 100, device: str | None = None) -> dict[str, float]:
    """Drive for so many steps.

    Args:
        steps: How many.
        device: Warp device; None for a GPU if there is one.

    Returns:
        Images a second of calls and of replays, how many pixels saw the person (share), and how
        many pixels differ between a replay and a call (none).
    """
    room = scanned_room().prepare(device=device)
    lens = dw.PinholeCamera.from_fov((90, 74), SIZE)
    sensor = dw.sim.DepthSensor(
        WORLDS, 1, SIZE, lens, PERSON_POINTS, device, ("depth", "index"), static_map=room
    )
    where = room.device
    clock = wp.zeros(1, dtype=wp.int32, device=where)
    points = wp.zeros((WORLDS, PERSON_POINTS), dtype=wp.vec3f, device=where)
    poses = wp.zeros((WORLDS, 1), dtype=wp.mat44f, device=where)

    def step() -> dict[str, wp.array]:
        wp.launch(drive, dim=WORLDS, inputs=[clock], outputs=[poses], device=where)
        wp.launch(walk, dim=points.shape, inputs=[clock], outputs=[points], device=where)
        wp.launch(count_up, dim=1, outputs=[clock], device=where)
        return sensor.step(points, poses)

    images = step()  # compiles; from here on nothing is allocated
    with wp.ScopedCapture(device=where) as capture:
        step()
    replays = _images_per_second(lambda: wp.capture_launch(capture.graph), steps, where)
    replayed = images["depth"].numpy().copy()

    clock.fill_(1)  # the same steps once more, each a call
    calls = _images_per_second(step, steps, where)
    differ = int(np.count_nonzero(images["depth"].numpy() != replayed))
    person = (images["index"].numpy() >= len(room)).mean()
    print(f"{WORLDS} worlds, {SIZE[0]} x {SIZE[1]} px, {len(room):,} points of the room on {where}")
    print(f"calls {calls:,.0f} images/s, replays {replays:,.0f}; {differ} pixels differ")
    print(f"the person fills {person:.1%} of the last images; {sensor.status()}")
    return {"calls": calls, "replays": replays, "person": float(person), "differ": differ}


def _images_per_second(step: Callable[[], object], steps: int, device: wp.Device) -> float:
    begin = time.perf_counter()
    for _ in range(steps):
        step()
    wp.synchronize_device(device)
    return WORLDS * steps / (time.perf_counter() - begin)


if __name__ == "__main__":
    main()
