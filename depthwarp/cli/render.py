"""`depthwarp render`: one cloud, one view, one depth map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from depthwarp.cli.drawing_options import (
    CameraNameOption,
    DepthChoice,
    DepthOption,
    EncodingChoice,
    FilterChoice,
    FiltersOption,
    FovOption,
    MaxRangeOption,
    MinRangeOption,
    SizeOption,
    chain_of,
)
from depthwarp.cli.guard import run_command
from depthwarp.cli.options import CloudArgument, DeviceOption, JsonOption, OffsetOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.cli.view_options import (
    FrameChoice,
    PoseOptions,
    RangeOptions,
    described_view,
    is_optical_frame,
    view_of_file,
)
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.depth_map import DepthMap
    from depthwarp.encodings import EncodingName

__all__ = ["render"]


def render(
    cloud: CloudArgument,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Depth map: png (16 bit), tiff, exr or npz.")
    ],
    position: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Where the camera stands, P_C [m]."),
    ] = None,
    orientation: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="A B G", help="Roll, pitch and yaw, C_O [degrees]."),
    ] = None,
    fov: FovOption = None,
    size: SizeOption = None,
    q_depth_map: Annotated[
        float | None,
        typer.Option(metavar="M", help="Pixel size on the depth plane [m]: the paper's view."),
    ] = None,
    q_line: Annotated[
        float | None,
        typer.Option(metavar="M", help="Step of the range view's edges [m]; 0.01 unless given."),
    ] = None,
    depth_plane: Annotated[
        float | None,
        typer.Option(metavar="M", help="Distance that the range view reaches, D_PD [m]."),
    ] = None,
    position_frame: Annotated[
        FrameChoice | None,
        typer.Option(help="Frame of the position: world unless given; rotated is the paper's."),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            help="Take lens and pose from a camera file (OpenCV, ROS, COLMAP, Open3D, KITTI, "
            "nerfstudio) or a depth map's; --position and --orientation put it elsewhere."
        ),
    ] = None,
    camera_name: CameraNameOption = None,
    depth: DepthOption = DepthChoice.range,
    filters: FiltersOption = FilterChoice.paper,
    min_range: MinRangeOption = 0.0,
    max_range: MaxRangeOption = 15.0,
    encoding: Annotated[
        EncodingChoice | None,
        typer.Option(help="Numbers of a png: 65535 = max range (range16), mm, or m * 256."),
    ] = None,
    offset: OffsetOption = None,
    device: DeviceOption = None,
    as_json: JsonOption = False,
) -> None:
    """Render a point cloud into a depth map.

    Either --size (a pinhole camera) or --q-depth-map (the paper's range view and depth plane)
    says how large the image is; --camera takes lens and pose from a file.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        import depthwarp as dw
        from depthwarp.saving import check_output

        pose = PoseOptions(position, orientation, position_frame)
        ranges = RangeOptions(q_depth_map, q_line, depth_plane)
        if camera is None:
            view = described_view(pose, fov, size, ranges, camera_name)
        else:
            with reporter.lens_warnings(camera):
                view = view_of_file(camera, camera_name, pose, fov, size, ranges)
            if position is None and is_optical_frame(view):
                reporter.say(
                    f"{camera} says no pose: the cloud is taken to be in the camera's optical "
                    "frame (X right, Y down, Z forward); --position and --orientation place it"
                )
        if isinstance(view, dw.Camera):
            view.check_kind(depth.value)
        encoding_name: EncodingName | None = None if encoding is None else encoding.value
        check_output(output, encoding_name, max_range)
        _check_inputs_survive(output, cloud, camera)
        with reporter.stage("read", f"reading {cloud}"):
            points = dw.read(cloud, offset=offset)
        if len(points) == 0:
            raise InputError(f"{cloud} holds no points: there is nothing to render")
        if not np.isfinite(points.points_world).all(axis=1).any():
            raise InputError(f"{cloud}: not one of its {len(points)} points is finite")
        with reporter.stage("render", f"rendering {len(points):,} points"):
            depth_map = dw.render(
                points,
                view,
                depth=depth.value,
                filters=chain_of(filters),
                min_range=min_range,
                max_range=max_range,
                device=device,
            )
        with reporter.stage("save", f"writing {output}"):
            depth_map.save(output, encoding_name)
        _report(reporter, depth_map, output)

    run_command(reporter, command)


def _check_inputs_survive(output: Path, *inputs: Path | None) -> None:
    """Refuse an output that would replace one of the files that are read."""
    written = {output.resolve(), output.with_name(output.name + ".json").resolve()}
    for path in inputs:
        if path is not None and path.resolve() in written:
            raise InputError(f"cannot write {output}: it would replace {path}, which is read")


def _report(reporter: Reporter, depth_map: DepthMap, output: Path) -> None:
    from depthwarp.saving import describe_depth_map

    description = describe_depth_map(depth_map)
    if reporter.as_json:
        reporter.result({"output": str(output), "seconds": reporter.seconds} | description)
        return
    stats, pixels = depth_map.stats, description["pixels"]
    reporter.say(
        f"{output}: {description['width']} x {description['height']} px, {depth_map.kind} depth, "
        + ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in pixels.items())
    )
    reporter.say(
        f"points: {stats.total:,} = "
        + " + ".join(
            f"{count:,} {name.replace('_', ' ')}"
            for name, count in stats.items()
            if count and name != "total"
        )
    )
    if stats.drawn == 0:
        reporter.say("warning: the depth map is empty; the counts above say why")
