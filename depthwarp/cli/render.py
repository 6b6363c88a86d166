"""`depthwarp render`: one cloud, one view, one depth map."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import CloudArgument, DeviceOption, JsonOption, OffsetOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.cameras import PinholeCamera
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
    position_frame: Annotated[
        FrameChoice, typer.Option(help="Frame of the position; 'rotated' is the paper's reading.")
    ] = FrameChoice.world,
    camera: Annotated[
        Path | None,
        typer.Option(help="Take the camera of a depth map's .json or .npz instead."),
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
        view = _view(camera, position, orientation, fov, size, q_depth_map, q_line, position_frame)
        quiet_warp()
        import depthwarp as dw
        from depthwarp.saving import check_output

        encoding_name: EncodingName | None = None if encoding is None else encoding.value
        check_output(output, encoding_name)
        with reporter.stage("read", f"reading {cloud}"):
            points = dw.read(cloud, offset=offset)
        if len(points) == 0:
            raise InputError(f"{cloud} holds no points: there is nothing to render")
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


def _view(
    camera: Path | None,
    position: tuple[float, float, float] | None,
    orientation: tuple[float, float, float] | None,
    fov: tuple[float, float] | None,
    size: tuple[int, int] | None,
    q_depth_map: float | None,
    q_line: float | None,
    position_frame: FrameChoice,
) -> PinholeCamera | RangeView:
    """The camera or range view that the options describe."""
    from depthwarp.cameras import PinholeCamera
    from depthwarp.range_view import RangeView
    from depthwarp.saving import load_camera

    if camera is not None:
        if any(given is not None for given in (position, orientation, fov, size, q_depth_map)):
            raise InputError(
                "--camera already says pose and lens: leave out --position, --orientation, --fov, "
                "--size and --q-depth-map"
            )
        return load_camera(camera)
    if position is None or orientation is None or fov is None:
        raise InputError(
            "give --position X Y Z, --orientation A B G and --fov H V, or --camera FILE"
        )
    if (size is None) == (q_depth_map is None):
        raise InputError("give either --size W H or --q-depth-map M")
    if size is not None:
        if q_line is not None:
            raise InputError("--q-line is a step of the range view: it goes with --q-depth-map")
        return PinholeCamera.from_fov(fov, size, position, orientation, position_frame.value)
    return RangeView(
        position=position,
        orientation=orientation,
        fov=fov,
        q_line=0.01 if q_line is None else q_line,
        q_depth_map=q_depth_map or 0.0,
        position_frame=position_frame.value,
    )


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
