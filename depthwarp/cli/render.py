"""`depthwarp render`: one cloud, one view, one depth map."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import CloudArgument, DeviceOption, JsonOption, OffsetOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.cameras import PinholeCamera, PositionFrame
    from depthwarp.depth_map import DepthMap
    from depthwarp.encodings import EncodingName
    from depthwarp.range_view import RangeView

__all__ = ["render"]


class DepthChoice(StrEnum):
    """Depth kinds by name."""

    range = "range"
    z = "z"


class FilterChoice(StrEnum):
    """Filter chains by name."""

    paper = "paper"
    none = "none"


class EncodingChoice(StrEnum):
    """16-bit encodings by name."""

    range16 = "range16"
    millimetres = "millimetres"
    kitti = "kitti"


class FrameChoice(StrEnum):
    """Readings of the position by name."""

    world = "world"
    rotated = "rotated"


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
    fov: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="H V", help="Field of view, horizontal and vertical [degrees]."),
    ] = None,
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="W H", help="Image size [px]: a camera with the field of view."),
    ] = None,
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
        typer.Option(help="Take pose and lens of a depth map's .json or .npz instead."),
    ] = None,
    depth: Annotated[
        DepthChoice, typer.Option(help="Euclidean range, or z along the optical axis.")
    ] = DepthChoice.range,
    filters: Annotated[
        FilterChoice, typer.Option(help="The paper's erase and dilation, or none.")
    ] = FilterChoice.paper,
    min_range: Annotated[float, typer.Option(help="Nearest depth that is drawn [m].")] = 0.0,
    max_range: Annotated[float, typer.Option(help="Farthest depth that is drawn [m].")] = 15.0,
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
    says how large the image is; --camera takes both pose and lens from a file.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        import depthwarp as dw
        from depthwarp.saving import check_output

        pose = PoseOptions(position, orientation, fov, position_frame)
        view = _view(camera, pose, size, RangeOptions(q_depth_map, q_line, depth_plane))
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
                filters=dw.filters.paper() if filters is FilterChoice.paper else None,
                min_range=min_range,
                max_range=max_range,
                device=device,
            )
        with reporter.stage("save", f"writing {output}"):
            depth_map.save(output, encoding_name)
        _report(reporter, depth_map, output)

    run_command(reporter, command)


class PoseOptions(NamedTuple):
    """The options that say pose and field of view."""

    position: tuple[float, float, float] | None
    orientation: tuple[float, float, float] | None
    fov: tuple[float, float] | None
    position_frame: FrameChoice | None


class RangeOptions(NamedTuple):
    """The options of the paper's range view."""

    q_depth_map: float | None
    q_line: float | None
    depth_plane: float | None


def _view(
    camera: Path | None,
    pose: PoseOptions,
    size: tuple[int, int] | None,
    range_view: RangeOptions,
) -> PinholeCamera | RangeView:
    """The camera or range view that the options describe."""
    from depthwarp.cameras import PinholeCamera
    from depthwarp.range_view import RangeView
    from depthwarp.saving import load_camera

    if camera is not None:
        if any(given is not None for given in (*pose, size, *range_view)):
            raise InputError(
                "--camera already says pose and lens: leave out --position, --orientation, --fov, "
                "--position-frame, --size and the options of the range view"
            )
        return load_camera(camera)
    position, orientation, fov, frame = pose
    if position is None or orientation is None or fov is None:
        raise InputError(
            "give --position X Y Z, --orientation A B G and --fov H V, or --camera FILE"
        )
    frame_name: PositionFrame = "world" if frame is None else frame.value
    q_depth_map, q_line, depth_plane = range_view
    if (size is None) == (q_depth_map is None):
        raise InputError("give either --size W H or --q-depth-map M")
    if size is not None:
        if q_line is not None or depth_plane is not None:
            raise InputError(
                "--q-line and --depth-plane belong to the range view: they go with --q-depth-map"
            )
        return PinholeCamera.from_fov(fov, size, position, orientation, frame_name)
    return RangeView(
        position=position,
        orientation=orientation,
        fov=fov,
        q_line=0.01 if q_line is None else q_line,
        q_depth_map=q_depth_map or 0.0,
        position_frame=frame_name,
        depth_plane=depth_plane,
    )


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
        + ", ".join(f"{count:,} {name}" for name, count in pixels.items())
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
