"""The twin's camera as a frame source, and its turn as a folder of files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameError,
    FrameSource,
    FrameTimeoutError,
    IncompleteFrameError,
    PixelFormat,
)
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.scan import run_scan
from depthwarp.scanner.twin import (
    CameraFault,
    Scene,
    Sensor,
    Shot,
    StillHead,
    TwinCamera,
    TwinRenderer,
    render_turn_to_folder,
    turn_shots,
)
from tests.scanner.fakes import FakeAxis, FakeSource

SMALL = reference_geometry(0.1)


def renderer(sensor: Sensor | None = None) -> TwinRenderer:
    return TwinRenderer(Scene(furnished_room()), SMALL, (1.79, 3.3, 1.2), sensor=sensor)


def test_frames_carry_what_was_set() -> None:
    """A frame has the camera's settings, both clocks, and its number; opening says what it is."""
    camera: FrameSource = TwinCamera(renderer(), StillHead(30.0, True))
    info = camera.open()
    assert info.is_emulated and info.serial == "TWIN-0001"
    assert info.size == SMALL.lens.size and info.pixel_format is PixelFormat.BAYER_RGGB
    camera.configure(700.0, 3.0)
    first, second = camera.grab(1.0), camera.grab(1.0)
    assert first.pixels.shape == SMALL.lens.size[::-1] and first.bits == 8
    assert (first.exposure_us, first.gain_db) == (700.0, 3.0)
    assert (first.sequence, second.sequence) == (0, 1)
    assert first.camera_time_ns is not None and second.camera_time_ns is not None
    assert second.camera_time_ns > first.camera_time_ns >= 0
    assert second.host_time_ns >= first.host_time_ns > 1_600_000_000 * 10**9
    camera.close()
    camera.close()


def test_grab_sees_the_head_as_it_is() -> None:
    """Each grab has the angle and the laser of that moment, whoever moves the head."""
    head, scene = StillHead(), renderer()
    with TwinCamera(scene, head) as camera:
        for head.true_angle, head.laser_on in ((0.0, True), (0.0, False), (33.75, True)):
            expected = scene.render(Shot(head.true_angle, head.laser_on))
            np.testing.assert_array_equal(camera.grab(1.0).pixels, expected)


def test_noise_is_new_in_every_frame_and_repeats_in_a_new_run() -> None:
    """Frames at one angle differ by noise; a second run that starts there gets the same frames."""
    runs = []
    for detour in (False, True):
        head = StillHead(5.0, True)
        with TwinCamera(renderer(), head) as camera:
            if detour:
                camera.grab(1.0)
                head.true_angle = 90.0
                camera.grab(1.0)
                head.true_angle = 5.0
            runs.append([camera.grab(1.0).pixels for _ in range(2)])
    assert (runs[0][0] != runs[0][1]).any()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_faults_on_request() -> None:
    """Faults come in the order asked for, once each; the next grab succeeds again."""
    camera = TwinCamera(renderer(), StillHead())
    camera.open()
    camera.fail(CameraFault.TIMEOUT, grabs=2)
    camera.fail(CameraFault.INCOMPLETE)
    camera.fail(CameraFault.WRONG_SIZE)
    for _ in range(2):
        with pytest.raises(FrameTimeoutError, match=r"0.5 s"):
            camera.grab(0.5)
    with pytest.raises(IncompleteFrameError):
        camera.grab(0.5)
    assert camera.grab(0.5).pixels.shape != SMALL.lens.size[::-1]
    assert camera.grab(0.5).pixels.shape == SMALL.lens.size[::-1]


def test_lost_camera_stays_lost_until_opened() -> None:
    """After a loss every grab fails until the camera is opened again."""
    camera = TwinCamera(renderer(), StillHead())
    camera.open()
    camera.fail(CameraFault.LOST)
    for _ in range(3):
        with pytest.raises(DeviceLostError, match="open it again"):
            camera.grab(1.0)
    camera.open()
    assert camera.grab(1.0).sequence == 0


def test_misuse_is_refused() -> None:
    """Settings out of range, and a grab from a camera that is not open, are refused in words."""
    camera = TwinCamera(renderer(), StillHead())
    with pytest.raises(FrameError, match="not open"):
        camera.grab(1.0)
    for exposure, gain in ((1.0, 0.0), (2e6, 0.0), (float("nan"), 0.0), (2000.0, 40.0)):
        with pytest.raises(InputError, match="must be from"):
            camera.configure(exposure, gain)


@pytest.mark.parametrize("with_off_frame", [True, False])
def test_a_turns_shots_are_those_of_a_scan(tmp_path: Path, with_off_frame: bool) -> None:
    """Angle, laser, exposure and gain of each shot, in the very order of `run_scan`'s grabs."""
    plan = ScanPlan((0.0, 33.75), (500.0, 4000.0), 3.0, 0.0, with_off_frame)
    axis, taken = FakeAxis(), list[Shot]()

    class Watched(FakeSource):
        def grab(self, timeout_s: float) -> Frame:
            taken.append(Shot(axis.angle, axis.laser, self.exposure, self.gain))
            return super().grab(timeout_s)

    source = Watched(axis)
    run_scan(Recording.create(tmp_path, plan, source.info, {}), source, axis)
    assert turn_shots(plan) == taken
    assert len(taken) == (8 if with_off_frame else 4)
    assert {shot.angle for shot in turn_shots(plan, (1.0, 2.0))} == {1.0, 2.0}


@pytest.mark.parametrize("sensor", [Sensor(), Sensor(PixelFormat.BGR), Sensor(bits=12)])
def test_folder_holds_the_frames(tmp_path: Path, sensor: Sensor) -> None:
    """Each file is the shot to the bit, and the names sort like the shots."""
    scene = renderer(sensor)
    shots = turn_shots(ScanPlan((0.0, 33.75), (500.0, 4000.0), with_off_frame=False))
    done: list[tuple[int, int]] = []
    files = render_turn_to_folder(scene, shots, tmp_path / "turn", lambda *n: done.append(n))
    assert sorted((tmp_path / "turn").iterdir()) == files and done[-1] == (4, 4)
    for file, shot in zip(files, shots, strict=True):
        np.testing.assert_array_equal(
            cv2.imread(str(file), cv2.IMREAD_UNCHANGED), scene.render(shot)
        )


def test_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    """A turn that breaks off leaves nothing behind; an old folder is never written to."""

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    shots = turn_shots(ScanPlan((0.0,)))
    with pytest.raises(KeyboardInterrupt):
        render_turn_to_folder(renderer(), shots, tmp_path / "turn", stop)
    assert not list(tmp_path.iterdir())
    (tmp_path / "old").mkdir()
    for folder, words in (("old", "exists"), ("none/turn", "does not exist")):
        with pytest.raises(InputError, match=words):
            render_turn_to_folder(renderer(), shots, tmp_path / folder)
    with pytest.raises(InputError, match="empty"):
        render_turn_to_folder(renderer(), [], tmp_path / "turn")
