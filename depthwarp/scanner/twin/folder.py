"""A turn of the twin as a folder of PNG files, for an emulated camera or a folder source."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2

from depthwarp.errors import InputError
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.twin.renderer import Shot, TwinRenderer

__all__ = ["render_turn_to_folder", "turn_shots"]


def turn_shots(plan: ScanPlan, angles: Sequence[float] | None = None) -> list[Shot]:
    """The shots of a turn in the order in which `run_scan` takes them.

    Args:
        plan: Of the scan: at each stop its exposures without the laser, if it has such, then
            those with it.
        angles: Where the head really stands at the stops [degrees]; as commanded unless given.
    """
    lasers = (False, True) if plan.with_off_frame else (True,)
    return [
        Shot(float(angle), laser_on, exposure, plan.gain_db)
        for angle in (plan.angles if angles is None else angles)
        for laser_on in lasers
        for exposure in plan.exposures_us
    ]


def render_turn_to_folder(
    renderer: TwinRenderer,
    shots: Sequence[Shot],
    folder: str | os.PathLike[str],
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Render shots into `frame_000000.png`, `frame_000001.png` and so on.

    The names sort like the shots, also as plain strings. A mosaic is stored as a grey picture,
    BGR in colour, more than 8 bits as 16-bit numbers. The folder appears when all is done.

    Args:
        renderer: What renders.
        shots: What to render, in order.
        folder: A folder that does not exist yet, in one that does.
        progress: Called with the shots done and the shots in all.

    Returns:
        The files, in order.

    Raises:
        InputError: No shots, the folder exists, its parent does not, or it cannot be written.
    """
    target = Path(folder)
    if not shots:
        raise InputError("shots is empty: give at least one")
    if target.exists():
        raise InputError(f"cannot render into {target}: it exists; give a new folder's name")
    if not target.parent.is_dir():
        raise InputError(f"cannot render into {target}: folder {target.parent} does not exist")
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}")
    try:
        temporary.mkdir()
        names = [f"frame_{number:06d}.png" for number in range(len(shots))]
        for number, (name, shot) in enumerate(zip(names, shots, strict=True)):
            coded, data = cv2.imencode(".png", renderer.render(shot))
            if not coded:
                raise InputError(f"cannot code {target / name} as PNG")
            (temporary / name).write_bytes(data.tobytes())
            if progress is not None:
                progress(number + 1, len(shots))
        os.rename(temporary, target)
    except OSError as error:
        raise InputError(
            f"cannot render into {target}: {error.strerror}; choose another folder"
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return [target / name for name in names]
