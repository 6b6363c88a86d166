"""A scan on disk: raw frames, a journal that survives a kill at any moment, and the settings.

A recording is a folder:

- `scan.json`: the plan, the camera, the versions and the calibration's hash, written once;
- `frames/STEP_KIND.npy`: raw pixels, each file whole or absent;
- `journal.jsonl`: one line a finished stop, with the reported angle and a checksum of every frame.

A stop counts only when its line is in the journal, and the line is written after its frames have
reached the disk: a kill loses at most the stop under way, which is then taken again.
"""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path
from depthwarp.scanner.frames import Frame, PixelFormat, SourceInfo
from depthwarp.scanner.plan import ScanPlan

__all__ = ["Recording", "Step", "lit", "off"]

SCHEMA = "depthwarp scan 1"


def off(exposure: int) -> str:
    """Name of the frame without the laser of exposure number `exposure` of the plan."""
    return f"off{exposure}"


def lit(exposure: int) -> str:
    """Name of the lit frame of exposure number `exposure` of the plan."""
    return f"on{exposure}"


@dataclass(frozen=True)
class Step:
    """A finished stop.

    Attributes:
        number: Index into the plan's angles.
        commanded: Angle that was asked for [degrees].
        reported: Angle at which the controller says the head stood [degrees].
        frames: Frame by name: `off(0)`, `lit(0)`, `off(1)`, `lit(1)`, ...
    """

    number: int
    commanded: float
    reported: float
    frames: Mapping[str, Frame]

    @property
    def exposures(self) -> list[tuple[Frame, Frame | None]]:
        """For each exposure of the plan the lit frame and the one without the laser, if any."""
        count = sum(name.startswith("on") for name in self.frames)
        return [(self.frames[lit(k)], self.frames.get(off(k))) for k in range(count)]


class Recording:
    """A folder that holds a scan; made by `create`, found again by `open`."""

    def __init__(self, folder: Path, entries: dict[str, Any]) -> None:
        self.folder = folder
        self._entries = entries
        self._lines, self._journal_bytes = _read_journal(folder / "journal.jsonl")
        self.plan = ScanPlan.from_json(entries["plan"])
        self.source = SourceInfo(
            **{
                **entries["source"],
                "size": tuple(entries["source"]["size"]),
                "pixel_format": PixelFormat(entries["source"]["pixel_format"]),
            }
        )

    @classmethod
    def create(
        cls,
        folder: Path,
        plan: ScanPlan,
        source: SourceInfo,
        settings: Mapping[str, Any],
    ) -> Recording:
        """Begin a recording in a folder that holds none yet.

        Args:
            folder: Made if it does not exist.
            plan: What the scan does.
            source: The camera.
            settings: JSON values to keep: versions, calibration hash, camera settings.

        Raises:
            InputError: The folder holds a recording already, or cannot be written.
        """
        if (folder / "scan.json").exists():
            raise InputError(
                f"{folder} holds a scan already: continue it with --resume, or choose another "
                "folder"
            )
        try:
            (folder / "frames").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror}") from error
        entries = {
            "schema": SCHEMA,
            "plan": plan.to_json(),
            "source": {
                "name": source.name,
                "serial": source.serial,
                "size": list(source.size),
                "pixel_format": str(source.pixel_format),
                "is_emulated": source.is_emulated,
            },
            "settings": dict(settings),
        }
        with atomic_path(folder / "scan.json") as temporary:
            _write_through(temporary, json.dumps(entries, indent=1).encode())
        _sync_folder(folder)
        return cls(folder, entries)

    @classmethod
    def open(cls, folder: Path) -> Recording:
        """Find a recording again; a line that a kill left unfinished in its journal is passed over.

        Raises:
            FileNotFoundError: The folder holds no recording.
            FileFormatError: Its settings or its journal are damaged; the message says where.
        """
        path = folder / "scan.json"
        try:
            entries = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{folder} holds no scan: there is no {path}") from error
        except ValueError as error:
            raise FileFormatError(f"{path} is damaged ({error}): start a new scan") from error
        if not isinstance(entries, dict) or entries.get("schema") != SCHEMA:
            raise FileFormatError(f"{path} is not a scan of this version ('{SCHEMA}')")
        try:
            return cls(folder, entries)
        except (KeyError, TypeError, InputError) as error:
            if isinstance(error, FileFormatError):
                raise
            raise FileFormatError(f"{path} is damaged ({error}): start a new scan") from error

    @property
    def settings(self) -> Mapping[str, Any]:
        """What was kept beside plan and camera when the recording began."""
        settings: Mapping[str, Any] = self._entries["settings"]
        return settings

    @property
    def finished(self) -> frozenset[int]:
        """Numbers of the stops that are done."""
        return frozenset(self._lines)

    @property
    def remaining(self) -> list[int]:
        """Numbers of the stops that are still to be taken, in order."""
        return [number for number in range(len(self.plan.angles)) if number not in self._lines]

    def append(self, step: Step) -> None:
        """Keep a finished stop: its frames first, then its line in the journal.

        When this returns, the stop survives a power cut.

        Raises:
            InputError: The stop is kept already, or the disk refuses (full, gone).
        """
        if step.number in self._lines:
            raise InputError(f"stop {step.number} is recorded already")
        try:
            frames = {
                name: self._write_frame(step.number, name, frame)
                for name, frame in step.frames.items()
            }
            _sync_folder(self.folder / "frames")
            entry: dict[str, Any] = {
                "step": step.number,
                "commanded": step.commanded,
                "reported": step.reported,
                "frames": frames,
            }
            line = _seal(entry)
            with (self.folder / "journal.jsonl").open("ab") as journal:
                journal.truncate(self._journal_bytes)  # what a kill left of an unfinished line
                journal.write(line)
                journal.flush()
                os.fsync(journal.fileno())
            _sync_folder(self.folder)
        except OSError as error:
            raise InputError(
                f"cannot record stop {step.number} in {self.folder}: {error.strerror}; make room "
                "and continue with --resume"
            ) from error
        self._lines[step.number] = entry
        self._journal_bytes += len(line)

    def steps(self) -> Iterator[Step]:
        """The finished stops in the plan's order, frames verified.

        Raises:
            FileFormatError: A frame is missing or differs from its checksum.
        """
        for number in sorted(self._lines):
            yield self.step(number)

    def step(self, number: int) -> Step:
        """One finished stop, frames verified; see `steps`."""
        entry = self._lines[number]
        return Step(
            number=number,
            commanded=float(entry["commanded"]),
            reported=float(entry["reported"]),
            frames={
                name: self._read_frame(number, name, about)
                for name, about in entry["frames"].items()
            },
        )

    def _path(self, number: int, name: str) -> Path:
        return self.folder / "frames" / f"{number:06d}_{name}.npy"

    def _write_frame(self, number: int, name: str, frame: Frame) -> dict[str, Any]:
        pixels = np.ascontiguousarray(frame.pixels)
        with atomic_path(self._path(number, name)) as temporary, temporary.open("wb") as file:
            np.save(file, pixels, allow_pickle=False)
            file.flush()
            os.fsync(file.fileno())
        return {
            "checksum": zlib.crc32(pixels.data),
            "pixel_format": str(frame.pixel_format),
            "bits": frame.bits,
            "exposure_us": _or_null(frame.exposure_us),
            "gain_db": _or_null(frame.gain_db),
            "host_time_ns": frame.host_time_ns,
            "camera_time_ns": frame.camera_time_ns,
            "sequence": frame.sequence,
        }

    def _read_frame(self, number: int, name: str, about: Mapping[str, Any]) -> Frame:
        path = self._path(number, name)
        try:
            pixels = np.load(path, allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise FileFormatError(
                f"{path}: frame '{name}' of stop {number} cannot be read ({error}): copy the "
                "recording again"
            ) from error
        if zlib.crc32(np.ascontiguousarray(pixels).data) != about["checksum"]:
            raise FileFormatError(
                f"{path}: frame '{name}' of stop {number} differs from its checksum in the "
                "journal: copy the recording again"
            )
        return Frame(
            pixels=pixels,
            pixel_format=PixelFormat(about["pixel_format"]),
            bits=about["bits"],
            exposure_us=_or_nan(about["exposure_us"]),
            gain_db=_or_nan(about["gain_db"]),
            host_time_ns=about["host_time_ns"],
            camera_time_ns=about["camera_time_ns"],
            sequence=about["sequence"],
        )


def _seal(entry: dict[str, Any]) -> bytes:
    """One line of the journal: the entry and a checksum of its text."""
    text = json.dumps(entry, separators=(",", ":"))
    return f"{zlib.crc32(text.encode()):08x} {text}\n".encode()


def _unseal(line: bytes) -> dict[str, Any]:
    """The entry of a line.

    Raises:
        ValueError: The line is cut short or damaged.
    """
    checksum, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or int(checksum, 16) != zlib.crc32(text[:-1]):
        raise ValueError("checksum does not fit")
    entry: dict[str, Any] = json.loads(text)
    return entry


def _read_journal(path: Path) -> tuple[dict[int, dict[str, Any]], int]:
    """The entries by stop, and the length [byte] of the journal without an unfinished last line.

    Raises:
        FileFormatError: A line before the last one is damaged, or a stop stands there twice.
    """
    if not path.exists():
        return {}, 0
    entries: dict[int, dict[str, Any]] = {}
    lines: Sequence[bytes] = path.read_bytes().splitlines(keepends=True)
    good = 0
    for number, line in enumerate(lines, start=1):
        try:
            entry = _unseal(line)
        except ValueError as error:
            if number == len(lines):
                break
            raise FileFormatError(
                f"{path}: line {number} of {len(lines)} is damaged ({error}); the scan cannot be "
                "continued safely: restore the file, or start a new scan"
            ) from error
        if entry["step"] in entries:
            raise FileFormatError(f"{path}: line {number} records stop {entry['step']} again")
        entries[entry["step"]] = entry
        good += len(line)
    return entries, good


def _or_null(value: float) -> float | None:
    return None if math.isnan(value) else value


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _write_through(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make renames in a folder survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
