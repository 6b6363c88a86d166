"""`depthwarp batch`: one cloud, many views, one depth map each."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from depthwarp.cli.batch_progress import DrawnLine, Interruption
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
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.batch_job.outputs import Output
    from depthwarp.batch_job.views import Views
    from depthwarp.cloud import PointCloud
    from depthwarp.encodings import Encoding
    from depthwarp.prepared import PreparedCloud
    from depthwarp.rendering.config import RenderConfig

__all__ = ["batch"]

STACKED = (".npz", ".zarr")
"""Suffixes of outputs that hold all views as arrays."""


def batch(
    cloud: CloudArgument,
    poses: Annotated[
        Path,
        typer.Argument(
            metavar="POSES",
            help="TUM or KITTI odometry poses, a csv (x,y,z,roll,pitch,yaw[,name]: metres and "
            "degrees), an npz (optical_from_world, V x 4 x 4), or a camera file with lenses and "
            "poses, such as a COLMAP model.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="A folder, for a 16-bit png a view; one file .npz; or one store .zarr.",
        ),
    ],
    camera: Annotated[
        Path | None,
        typer.Option(help="Take the lens from a camera file, for poses that have none."),
    ] = None,
    camera_name: CameraNameOption = None,
    fov: FovOption = None,
    size: SizeOption = None,
    depth: DepthOption = DepthChoice.range,
    filters: FiltersOption = FilterChoice.paper,
    min_range: MinRangeOption = 0.0,
    max_range: MaxRangeOption = 15.0,
    encoding: Annotated[
        EncodingChoice | None,
        typer.Option(help="Numbers of the pngs: 65535 = max range (range16), mm, or m * 256."),
    ] = None,
    offset: OffsetOption = None,
    device: DeviceOption = None,
    as_json: JsonOption = False,
) -> None:
    """Render a point cloud into many depth maps.

    After a kill or a full disk the same command goes on with the views that are missing.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        with Interruption() as interruption:
            draw(interruption)

    def draw(interruption: Interruption) -> None:
        quiet_warp()
        from depthwarp.devices import resolve_device
        from depthwarp.rendering.config import RenderConfig

        config = RenderConfig(depth.value, min_range, max_range, chain_of(filters))
        target = resolve_device(device)
        numbers = _encoding(output, encoding, max_range)
        with reporter.lens_warnings(camera or poses):
            views = _views(poses, camera, camera_name, fov, size)
        for lens in views.lenses:
            lens.check_kind(config.depth)
        with interruption.held_off(_output(output, views, numbers)) as out:
            prepared = _begin(reporter, cloud, offset, out, config, numbers, target.alias)
            before, empty = out.done, 0
            if prepared is not None:
                empty = _draw(reporter, prepared, out, config, interruption)
            with reporter.stage("finish", f"finishing {output}"):
                out.finish()
            _report(reporter, out, len(views) - before, empty)

    run_command(reporter, command)


def _encoding(output: Path, choice: EncodingChoice | None, max_range: float) -> Encoding | None:
    """What the numbers of the files mean; None for the float32 of an NPZ or a Zarr store.

    Raises:
        InputError: An output that is neither, or an encoding that cannot hold the range.
    """
    from depthwarp.encodings import get_encoding

    suffix = output.suffix.lower()
    if suffix in STACKED:
        if choice is not None:
            raise InputError(
                f"cannot write {output}: encoding is for pngs, {suffix} is float32 metres"
            )
        return None
    if suffix in (".png", ".tiff", ".tif", ".exr", ".zip", ".h5"):
        raise InputError(
            f"cannot write {output}: give a folder, for pngs, or a name that ends in .npz or .zarr"
        )
    encoding = get_encoding("range16" if choice is None else choice.value, max_range)
    if max_range > encoding.largest * (1 + 1e-9):  # said now, not after hours
        raise InputError(
            f"encoding '{encoding.name}' holds depths up to {encoding.largest:.3f} m, --max-range "
            f"is {max_range:g}: give a smaller --max-range, another --encoding or an output .npz"
        )
    return encoding


def _views(
    poses: Path,
    camera: Path | None,
    camera_name: str | None,
    fov: tuple[float, float] | None,
    size: tuple[int, int] | None,
) -> Views:
    """The views that file and options say.

    Raises:
        InputError: Options are missing, or contradict each other or the file.
    """
    from depthwarp.batch_job.views import read_views
    from depthwarp.cameras import PinholeCamera
    from depthwarp.cli.view_options import camera_of_file

    if camera_name is not None and camera is None:
        raise InputError("--camera-name belongs to --camera FILE")
    if camera is not None:
        if fov is not None:
            raise InputError("--camera already says the lens: leave out --fov")
        return read_views(poses, camera_of_file(camera, camera_name, size))
    if fov is not None:
        if size is None:
            raise InputError("--fov H V needs --size W H")
        return read_views(poses, PinholeCamera.from_fov(fov, size))
    return read_views(poses, size=size)


def _output(path: Path, views: Views, encoding: Encoding | None) -> Output:
    from depthwarp.batch_job.npz_file import NpzFile
    from depthwarp.batch_job.outputs import PngFolder
    from depthwarp.batch_job.zarr_store import ZarrStore

    if encoding is not None:
        return PngFolder(path, views, encoding)
    return NpzFile(path, views) if path.suffix.lower() == ".npz" else ZarrStore(path, views)


def _points(path: Path, offset: tuple[float, float, float] | None) -> PointCloud:
    """The cloud, which has something to draw.

    Raises:
        InputError: It has no point, or none that is finite.
    """
    import depthwarp as dw

    points = dw.read(path, offset=offset)
    if len(points) == 0:
        raise InputError(f"{path} holds no points: there is nothing to render")
    if not np.isfinite(points.points_world).all(axis=1).any():
        raise InputError(f"{path}: not one of its {len(points)} points is finite")
    return points


def _begin(
    reporter: Reporter,
    cloud: Path,
    offset: tuple[float, float, float] | None,
    out: Output,
    config: RenderConfig,
    encoding: Encoding | None,
    device: str,
) -> PreparedCloud | None:
    """Find out what there is already, and prepare the cloud if views are missing."""
    from depthwarp.batch_job.description import describe_batch

    with reporter.stage("read", f"reading {cloud}"):
        points = _points(cloud, offset)
    out.begin(describe_batch(points, out.views, config, encoding))
    if out.done:
        reporter.say(f"continuing {out.path}: {out.done:,} of {len(out.views):,} views are there")
    if out.done == len(out.views):
        return None
    with reporter.stage("prepare", f"sorting {len(points):,} points"):
        return points.prepare(device=device)


def _draw(
    reporter: Reporter,
    cloud: PreparedCloud,
    out: Output,
    config: RenderConfig,
    interruption: Interruption,
) -> int:
    """Draw what is missing; how many of the views show no point.

    Raises:
        KeyboardInterrupt: A signal ended it before all views were drawn.
    """
    from depthwarp.batch_job.drawing import draw_batch

    total = len(out.views)
    begun = time.perf_counter()
    with DrawnLine(total, out.done) as drawn, interruption.is_awaited():
        draw_batch(cloud, out, config, wrote=drawn, is_stopped=lambda: interruption.has_come)
    reporter.seconds["draw"] = round(time.perf_counter() - begun, 4)
    if out.done < total:
        reporter.say(
            f"{out.done:,} of {total:,} views are written; the same command goes on with the rest"
        )
        raise KeyboardInterrupt
    return drawn.empty


def _report(reporter: Reporter, out: Output, drawn: int, empty: int) -> None:
    seconds = reporter.seconds.get("draw", 0.0)
    rate = drawn / seconds if seconds else 0.0
    if reporter.as_json:
        reporter.result(
            {
                "output": str(out.path),
                "views": len(out.views),
                "drawn": drawn,
                "empty": empty,
                "views_per_second": round(rate, 1),
                "seconds": reporter.seconds,
            }
        )
        return
    how = f", {drawn:,} of them drawn now, {rate:,.1f} views/s" if drawn else "; nothing to draw"
    reporter.say(f"{out.path}: {len(out.views):,} views{how}")
    if empty:
        reporter.say(f"warning: {empty:,} of the views drawn now show no point")
