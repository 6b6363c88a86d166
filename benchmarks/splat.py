"""How many points a second become a depth image: depthwarp next to its peers.

Run `python -m benchmarks.splat`; README.md says the method.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import warp as wp
from rich.console import Console

from benchmarks.measure import alternate, machine, read_bandwidth, run_once
from benchmarks.peers import Peer, count_differing_pixels, installed_peers
from benchmarks.report import (
    BYTES_A_POINT,
    Result,
    append_json_lines,
    first_call_table,
    result_table,
)
from benchmarks.scenes import RoomScene
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import resolve_device
from depthwarp.errors import DeviceError

FIRST_CALL_POINTS = 1000
MAX_DIFFERING_SHARE = 2e-3
"""Of the pixels; rounding at pixel borders stays well below it, a wrong camera far above."""


class DifferentImageError(Exception):
    """A peer does not do the same work, so its time says nothing."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.json is not None and not options.json.parent.is_dir():
        parser.error(f"--json {options.json}: there is no folder {options.json.parent}")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as kernel_cache:
        wp.config.kernel_cache_dir = kernel_cache  # empty: the first call compiles
        quiet_warp()
        try:
            resolve_device(options.device)
            _run(options.points, options.repeats, options.device, options.json)
        except DeviceError as error:
            parser.error(str(error))
        except DifferentImageError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    return 0


def _run(points: Sequence[int], repeats: int, device: str, json: Path | None) -> None:
    console = Console(highlight=False)
    peers, left_out = installed_peers(device)
    for line in left_out:
        console.print(line)
    here, bandwidth = machine(), read_bandwidth()
    console.print(f"{here['processor']}, {here['cores']} cores, {here['system']}, ", end="")
    console.print(f"Python {here['python']}, Warp {here['warp']}")
    console.print(f"read bandwidth of one thread: {bandwidth / 1e9:.1f} GB/s")

    console.print("\nFirst call, compiling included, no part of the figures below")
    first_call_s = [_first_call(peer) for peer in peers]
    console.print(first_call_table(peers, first_call_s))
    for count in points:
        scene = RoomScene(count)
        width, height = scene.image_size
        results = _measure(scene, peers, repeats)
        console.print(
            f"{scene.name}: {count:,} points of {BYTES_A_POINT} bytes, {width} x {height} pixels, "
            f"median of {repeats}"
        )
        console.print(result_table(scene, results, bandwidth))
        if json is not None:
            append_json_lines(json, here, bandwidth, scene, results, first_call_s)


def _first_call(peer: Peer) -> float:
    """Seconds of a first run on a small cloud: compiling and loading, with next to no work."""
    scene = RoomScene(FIRST_CALL_POINTS)
    peer.prepare(scene.points_world(), scene.camera(), scene.max_range_m)
    return run_once(peer.run)[0]


def _measure(scene: RoomScene, peers: Sequence[Peer], repeats: int) -> list[Result]:
    points, camera = scene.points_world(), scene.camera()
    for peer in peers:
        peer.prepare(points, camera, scene.max_range_m)
        peer.run()  # warm-up, and the image that is compared
    differing = _differing_pixels(peers)
    timings = alternate([peer.run for peer in peers], repeats)
    return [Result(*row) for row in zip(peers, differing, timings, strict=True)]


def _differing_pixels(peers: Sequence[Peer]) -> list[int]:
    """Pixels in which each peer's image differs from the first peer's.

    Raises:
        DifferentImageError: More differ than rounding explains.
    """
    reference = peers[0].image()
    limit = MAX_DIFFERING_SHARE * reference.size
    differing = [count_differing_pixels(peer.image(), reference) for peer in peers]
    for peer, pixels in zip(peers, differing, strict=True):
        if pixels > limit:
            raise DifferentImageError(
                f"{peer.name} draws another image than {peers[0].name}: {pixels} of "
                f"{reference.size} pixels differ, rounding explains at most {limit:.0f}"
            )
    return differing


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.splat", description=__doc__)
    parser.add_argument(
        "--points",
        type=_count,
        nargs="+",
        default=[1_000_000, 10_000_000],
        metavar="N",
        help="points of the cloud, one measurement each (default: 10^6 and 10^7)",
    )
    parser.add_argument(
        "--repeats",
        type=_count,
        default=7,
        metavar="N",
        help="timed runs of each peer (default: %(default)s)",
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="append the results to FILE, one JSON line a peer"
    )
    parser.add_argument(
        "--device",
        default="cpu",
        help="where depthwarp renders, e.g. cuda:0 (default: %(default)s)",
    )
    return parser


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text}")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
