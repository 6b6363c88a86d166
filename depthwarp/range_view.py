"""The paper's range view: nested rectangles that select the points and end in the depth plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import PinholeCamera, Pose, PositionFrame
from depthwarp.checks import MAX_SIDE, check_choice, check_finite_vector, check_fov, check_positive
from depthwarp.cloud import PointCloud
from depthwarp.devices import resolve_device
from depthwarp.errors import CapacityError, InputError
from depthwarp_kernels.segment import farthest_ahead, segment_kernel

__all__ = ["RangeView"]

MAX_LINES = 1 << 22
"""Most rectangles: below 2^23 the float32 division that guesses n is off by one at most."""


@dataclass(frozen=True)
class RangeView:
    """The paper's parameters P_C, C_FOV, C_O, q_L and q_DM, equations (1), (2), (3) and (7).

    The n-th rectangle stands at `X_n = n q_L cos h`, half width `Y_n = n q_L sin h`, half height
    `Z_n = n q_L tan v`, with h and v half the fields of view; the last one is the depth plane.
    The vertical angle is that of the side edges, as the paper's construction turns its "V" aside:
    on the optical axis the view is higher, `tan(v_axis) = tan v / cos h`.

    Attributes:
        position: P_C [m].
        orientation: C_O = (alpha, beta, gamma) about X, Y, Z [degrees].
        fov: C_FOV = (horizontal, vertical) [degrees], each above 0 and below 180.
        q_line: q_L, the step along the view's edges [m].
        q_depth_map: q_DM, the size of a pixel on the depth plane [m].
        position_frame: `"world"`, or `"rotated"` for the paper's own reading of P_C, see
            `Pose.from_orientation`.
        depth_plane: Distance D_PD [m] that the last rectangle has to reach; None takes the cloud's
            farthest point ahead.

    Raises:
        InputError: A number that is not finite or out of its range.

    Example:
        >>> import depthwarp as dw
        >>> view = dw.RangeView(position=(1.79, 3.3, 1.2), orientation=(0, 0, 90), fov=(60, 60))
    """

    position: tuple[float, float, float]
    orientation: tuple[float, float, float]
    fov: tuple[float, float]
    q_line: float = 0.01
    q_depth_map: float = 0.01
    position_frame: PositionFrame = "world"
    depth_plane: float | None = None

    def __post_init__(self) -> None:
        check_finite_vector("position", self.position, 3)
        check_finite_vector("orientation", self.orientation, 3)
        check_fov(self.fov)
        check_positive("q_line", self.q_line, "m")
        check_positive("q_depth_map", self.q_depth_map, "m")
        check_choice("position_frame", self.position_frame, ("world", "rotated"))
        if self.depth_plane is not None:
            check_positive("depth_plane", self.depth_plane, "m")

    @property
    def pose(self) -> Pose:
        """Where the view stands and looks."""
        return Pose.from_orientation(self.position, self.orientation, self.position_frame)

    @property
    def steps(self) -> tuple[float, float, float]:
        """Growth of a rectangle's (X, half width, half height) from one n to the next [m], (7)."""
        h, v = (math.radians(angle) / 2 for angle in self.fov)
        return (
            self.q_line * math.cos(h),
            self.q_line * math.sin(h),
            self.q_line * math.tan(v),
        )

    def line_count(self, cloud: PointCloud, *, device: str | None = None) -> int:
        """N_L, the number of rectangles: the last stands at or just behind the farthest point.

        Args:
            cloud: The cloud whose farthest point ahead counts, unless `depth_plane` is given.
            device: Where to compute, e.g. `"cpu"`, `"cuda:0"`; None is Warp's default device.

        Raises:
            InputError: No point is ahead, or there would be more than 4 million rectangles.
        """
        reach = self.depth_plane or self._farthest_ahead(cloud, resolve_device(device))
        lines = reach / self.steps[0] if self.steps[0] > 0 else math.inf  # a step can underflow
        if lines > MAX_LINES:
            raise InputError(
                f"q_line {self.q_line} m makes {lines:.4g} rectangles up to {reach:.4g} m, at most "
                f"{MAX_LINES} are possible: choose a larger q_line"
            )
        return max(1, math.ceil(lines))

    def rectangles(self, line_count: int) -> npt.NDArray[np.float64]:
        """The rectangles 1..line_count as rows (X_n, Y_n, Z_n) [m], shape (line_count, 3)."""
        numbers = np.arange(1, line_count + 1, dtype=np.float64)
        return np.stack([numbers * step for step in self.steps], axis=1)

    def corners_world(self, line_count: int) -> npt.NDArray[np.float64]:
        """The corners of the rectangles 1..line_count in the world frame.

        Returns:
            Corners [m], in order around each rectangle, shape (line_count, 4, 3).
        """
        x, y, z = self.rectangles(line_count).T
        corners = np.stack(
            [
                np.stack([x, side * y, top * z], axis=1)
                for side, top in ((1, 1), (-1, 1), (-1, -1), (1, -1))
            ],
            axis=1,
        )
        world: npt.NDArray[np.float64] = corners @ self.pose.rotation + self.pose.center_world
        return world

    def segment(
        self,
        cloud: PointCloud,
        *,
        dtype: type[np.floating[Any]] = np.float32,
        device: str | None = None,
    ) -> npt.NDArray[np.bool_]:
        """The points inside the range view, equations (8) and (9), in closed form.

        Args:
            cloud: Points in the world frame.
            dtype: Precision of the computation, `np.float32` (as rendering does) or `np.float64`.
            device: Where to compute; None is Warp's default device.

        Returns:
            Mask (N,), true where the point is selected: `cloud[mask]` is the segmented cloud.

        Raises:
            InputError: No point is ahead and no `depth_plane` is given, or another dtype.
        """
        if dtype not in (np.float32, np.float64):
            raise InputError(f"dtype must be np.float32 or np.float64, got {dtype}")
        target = resolve_device(device)
        scalar = wp.float32 if dtype is np.float32 else wp.float64
        vec3 = wp.types.vector(length=3, dtype=scalar)
        mat33 = wp.types.matrix(shape=(3, 3), dtype=scalar)
        pose = self.pose
        selected = arrays.empty(len(cloud), wp.uint8, target)
        wp.launch(
            segment_kernel(scalar),
            dim=len(cloud),
            inputs=[
                arrays.share_points(cloud.points_world, target),
                mat33(*pose.rotation.ravel().tolist()),
                vec3(*pose.position),
                vec3(*pose.shift),
                vec3(*self.steps),
                self.line_count(cloud, device=device),
            ],
            outputs=[selected],
            device=target,
        )
        mask: npt.NDArray[np.bool_] = selected.numpy().view(np.bool_)
        return mask

    def camera(self, cloud: PointCloud, *, device: str | None = None) -> PinholeCamera:
        """The pinhole camera of the depth plane: focal length `D_PD / q_DM` pixels, section 3.4.

        Args:
            cloud: The cloud whose farthest point ahead sets the depth plane.
            device: Where to compute; None is Warp's default device.

        Raises:
            InputError: No point is ahead and no `depth_plane` is given.
            CapacityError: The depth plane has too many pixels of `q_depth_map`.
        """
        return self.camera_of_plane(self.line_count(cloud, device=device))

    def camera_of_plane(self, line_count: int) -> PinholeCamera:
        """The pinhole camera whose depth plane is rectangle number `line_count`.

        Raises:
            CapacityError: The depth plane has too many pixels of `q_depth_map`.
        """
        distance, half_width, half_height = (line_count * step for step in self.steps)
        columns, rows = 2 * half_width / self.q_depth_map, 2 * half_height / self.q_depth_map
        if max(columns, rows) > MAX_SIDE:
            raise CapacityError(
                f"q_depth_map {self.q_depth_map} m makes a depth map of {columns:.4g} x {rows:.4g} "
                f"pixels at {distance:.4g} m, at most {MAX_SIDE} a side are possible: choose a "
                "larger q_depth_map"
            )
        width, height = max(1, round(columns)), max(1, round(rows))
        focal = distance / self.q_depth_map
        return PinholeCamera(
            fx=focal,
            fy=focal,
            cx=(width - 1) / 2,
            cy=(height - 1) / 2,
            width=width,
            height=height,
            pose=self.pose,
        )

    def _farthest_ahead(self, cloud: PointCloud, device: Any) -> float:
        pose = self.pose
        farthest = arrays.zeros(1, wp.uint32, device)
        wp.launch(
            farthest_ahead,
            dim=len(cloud),
            inputs=[
                arrays.share_points(cloud.points_world, device),
                wp.mat33f(*pose.rotation.ravel().tolist()),
                wp.vec3f(*pose.position),
                wp.vec3f(*pose.shift),
            ],
            outputs=[farthest],
            device=device,
        )
        distance = float(farthest.numpy().view(np.float32)[0])
        if distance == 0.0:
            raise InputError(
                f"range view at {self.position}: none of the cloud's {len(cloud)} points is ahead, "
                "so there is no depth plane: turn the view (orientation), or give depth_plane "
                "(--depth-plane)"
            )
        return distance
