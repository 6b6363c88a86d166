"""MuJoCo Warp in a scanned room: the robot by MuJoCo's ray caster, the room by depthwarp.

Run `python examples/mujoco_room.py` (needs `pip install mujoco-warp`; its kernels compile for
half a minute on the first run). Each of 16 worlds has a robot with an arm that swings in front of
its own camera. MuJoCo Warp steps the physics and renders the robot's depth; depthwarp draws the
points of the room and keeps the nearer of both in every pixel. Both images stay on the device: the
ray caster's buffer is handed to the sensor as it is. All of a step is one graph, on a GPU and on a
CPU.
"""

from __future__ import annotations

import time

import numpy as np
import warp as wp
from scanned_room import scanned_room

import depthwarp as dw

try:
    import mujoco
    import mujoco_warp as mjw
except ImportError as error:
    raise SystemExit(f"{error}: pip install mujoco-warp") from error

WORLDS, SIZE, FOV_Y_DEG = 16, (64, 48), 70.0

# The base slides and turns, the arm swings; the camera is on a mast behind the arm.
ROBOT = f"""
<mujoco>
  <option timestep="0.02" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base" pos="4 3 0.15">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <joint name="turn" type="hinge" axis="0 0 1"/>
      <geom type="cylinder" size="0.15 0.05" mass="5"/>
      <camera name="mast" pos="-0.2 0 0.6" xyaxes="0 -1 0 0.3 0 1" fovy="{FOV_Y_DEG}"/>
      <body name="arm" pos="0 0 0.1">
        <joint name="swing" type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0.25" size="0.03" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity joint="slide" kv="20"/>
    <velocity joint="turn" kv="5"/>
    <position joint="swing" kp="5" kv="0.5"/>
  </actuator>
</mujoco>
"""


# The rows of MuJoCo's camera matrix are the world's axes, its columns the camera's right, up and
# backward axes; optical axes are right, down and forward.
@wp.kernel
def camera_poses(
    # In:
    position: wp.array2d[wp.vec3f],
    axes: wp.array2d[wp.mat33f],
    # Out:
    poses_out: wp.array2d[wp.mat44f],
):
    """World to optical axes of each camera of each world."""
    world, camera = wp.tid()
    turn = wp.diag(wp.vec3f(1.0, -1.0, -1.0)) @ wp.transpose(axes[world, camera])
    shift = -(turn @ position[world, camera])
    poses_out[world, camera] = wp.mat44f(
        turn[0, 0], turn[0, 1], turn[0, 2], shift[0],
        turn[1, 0], turn[1, 1], turn[1, 2], shift[1],
        turn[2, 0], turn[2, 1], turn[2, 2], shift[2],
        0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


@wp.kernel
def command(data_time: wp.array[float], control_out: wp.array2d[float]):
    """Each robot drives, turns and swings its arm in its own way."""
    world = wp.tid()
    phase = 2.0 * data_time[world] + float(world)
    control_out[world, 0] = 0.4 * wp.sin(phase)
    control_out[world, 1] = 0.8
    control_out[world, 2] = 0.5 * wp.sin(1.7 * phase)


def main(steps: int = 50, device: str | None = None) -> dict[str, float]:
    """Drive for so many steps.

    Args:
        steps: How many.
        device: Warp device; None for a GPU if there is one.

    Returns:
        Images a second, the share of pixels that show the robot and the room, and whether the
        status is clean.
    """
    with wp.ScopedDevice(device or wp.get_preferred_device()) as where:
        host = mujoco.MjModel.from_xml_string(ROBOT)
        host_data = mujoco.MjData(host)
        mujoco.mj_forward(host, host_data)
        model = mjw.put_model(host)
        data = mjw.put_data(host, host_data, nworld=WORLDS)
        caster = mjw.create_render_context(
            host, nworld=WORLDS, cam_res=SIZE, render_rgb=False, render_depth=True
        )
        sensor = _room_sensor(where)
        robot_depth = caster.depth_data.reshape(sensor.shape)  # z depth, 0 where nothing is
        poses = wp.zeros((WORLDS, 1), dtype=wp.mat44f)

        def step() -> dict[str, wp.array]:
            wp.launch(command, dim=WORLDS, inputs=[data.time], outputs=[data.ctrl])
            mjw.step(model, data)
            mjw.refit_bvh(model, data, caster)
            mjw.render(model, data, caster)
            wp.launch(
                camera_poses,
                dim=poses.shape,
                inputs=[data.cam_xpos, data.cam_xmat],
                outputs=[poses],
            )
            return sensor.step(None, poses, scene_depth=robot_depth)

        images = step()  # compiles
        with wp.ScopedCapture() as capture:  # physics, ray caster and depthwarp as one graph
            step()
        begin = time.perf_counter()
        for _ in range(steps):
            wp.capture_launch(capture.graph)
        wp.synchronize()
        rate = WORLDS * steps / (time.perf_counter() - begin)
        depth, index = images["depth"].numpy(), images["index"].numpy()
    # What the other renderer saw has a depth and no point.
    robot, room = float(((depth > 0) & (index < 0)).mean()), float((index >= 0).mean())
    status = sensor.status()
    print(f"{WORLDS} worlds, {SIZE[0]} x {SIZE[1]} px, {steps} steps on {where}")
    print(f"physics and images together: {rate:,.0f} images/s; {status}")
    print(f"the robot fills {robot:.1%} of the last images, the room {room:.1%}")
    return {"rate": rate, "robot": robot, "room": room, "is_clean": status.is_clean}


def _room_sensor(device: wp.Device) -> dw.sim.DepthSensor:
    """A sensor of the room, with the camera of `ROBOT` and the kind of depth of its ray caster."""
    width, height = SIZE
    slope = np.tan(np.radians(FOV_Y_DEG) / 2) * width / height
    fov_x = 2 * np.degrees(np.arctan(slope))  # pixels are square
    return dw.sim.DepthSensor(
        WORLDS,
        1,
        SIZE,
        dw.PinholeCamera.from_fov((fov_x, FOV_Y_DEG), SIZE),
        max_points_per_world=1,
        device=device.alias,
        outputs=("depth", "index"),
        depth="z",
        static_map=scanned_room().prepare(device=device.alias),
    )


if __name__ == "__main__":
    main()
