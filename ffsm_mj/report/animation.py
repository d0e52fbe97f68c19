"""Animations of a run as GIF or MP4, drawn without a display or GPU."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from PIL import Image

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, MissingPackageError, OutputLostError
from ffsm_mj.report.output_place import new_file, usable_file
from ffsm_mj.report.pictures import pictures
from ffsm_mj.report.plots.style import publication
from ffsm_mj.report.plots.subject import Subject

_LONGEST_S = 12.0
_SPEEDS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)
_LAST_PICTURE_S = 1.5
_MOST_PICTURES = 6000


def write_animation(
    run: Run,
    path: Path,
    *,
    frames_per_second: float = 20.0,
    speed: float | None = None,
    report: Callable[[float, float], None] | None = None,
) -> str:
    """Write an animation of a run as ``.gif`` or ``.mp4``.

    Args:
        run: A run with at least one sample.
        path: The file; its suffix selects the format.
        frames_per_second: Frame rate.
        speed: Playback speed relative to real time; None: at most 12 s of video.
        report: Callback (frames drawn, frames in all).

    Returns:
        One line that describes the output.

    Raises:
        InputError: No samples, models that no longer compile, an unknown suffix, or a file that cannot be written.
        OutputLostError: The file could not be written completely.
        MissingPackageError: MP4 without imageio-ffmpeg.
    """
    writers = {".gif": _write_gif, ".mp4": _write_mp4}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: animations are .gif or .mp4 files")
    usable_file(path)
    cut = _cut(run, frames_per_second, speed, f"{path}: ", "raise --speed or lower --fps")
    with publication():
        writers[path.suffix.lower()](path, cut.pictures(report), frames_per_second)
    return cut.description


def gif(run: Run, *, frames_per_second: float = 20.0, speed: float | None = None) -> tuple[bytes, str]:
    """An animation of a run as the bytes of a GIF, and one line that describes it.

    Args:
        run: A run with at least one sample.
        frames_per_second: Frame rate.
        speed: Playback speed relative to real time; None: at most 12 s of video.

    Raises:
        InputError: No samples, models that no longer compile, or too many frames.
    """
    cut = _cut(run, frames_per_second, speed, "", "raise speed or lower frames_per_second")
    buffer = BytesIO()
    with publication():
        _save_gif(buffer, cut.pictures(), frames_per_second)
    return buffer.getvalue(), cut.description


@dataclass(frozen=True)
class _Cut:
    """Frames of an animation and their times.

    Attributes:
        subject: The run.
        times: Simulation time of each frame, s.
        speed: Playback speed relative to real time.
        description: One line that describes the animation.
    """

    subject: Subject
    times: FloatArray
    speed: float
    description: str

    def pictures(self, report: Callable[[float, float], None] | None = None) -> Iterator[Any]:
        """The frames, drawn lazily."""
        return _counted(pictures(self.subject, self.times, self.speed), len(self.times), report)


def _cut(run: Run, frames_per_second: float, speed: float | None, place: str, remedy: str) -> _Cut:
    end = run.digest.end_s
    fast = speed or next((s for s in _SPEEDS if end / s <= _LONGEST_S), end / _LONGEST_S)
    wanted = end / fast * frames_per_second
    if not wanted < _MOST_PICTURES:
        amount = f"{end:g} s at {fast:g} times real time need {wanted:.3g} frames"
        raise InputError(f"{place}{amount}, more than {_MOST_PICTURES}; {remedy}")
    count = max(2, 1 + math.ceil(wanted))
    times = np.linspace(0.0, end, count)
    description = f"{count} frames, {count / frames_per_second:.1f} s at {fast:g} times real time"
    return _Cut(Subject(run, times.tolist()), times, fast, description)


def _counted(pictures: Iterator[Any], count: int, report: Callable[[float, float], None] | None) -> Iterator[Any]:
    """The same frames, with progress reported after each."""
    for done, picture in enumerate(pictures, 1):
        if report is not None:
            report(done, count)
        yield picture


def _write_gif(path: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    buffer = BytesIO()
    _save_gif(buffer, pictures, frames_per_second)
    with new_file(path) as place:
        place.write_bytes(buffer.getvalue())


def _save_gif(to: BinaryIO, pictures: Iterator[Any], frames_per_second: float) -> None:
    images = [Image.fromarray(picture).quantize(64, Image.Quantize.FASTOCTREE) for picture in pictures]
    step = max(20, round(1000 / frames_per_second / 10) * 10)  # frame durations in GIF are in hundredths of a second
    durations = [step] * (len(images) - 1) + [round(1000 * _LAST_PICTURE_S)]
    images[0].save(to, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)


def _write_mp4(path: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    try:
        ffmpeg = import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingPackageError("--mp4", "imageio-ffmpeg", "mp4") from error
    with new_file(path) as place:
        _film(ffmpeg, path, place, pictures, frames_per_second)


def _film(ffmpeg: Any, path: Path, place: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    """Write the video to ``place``; errors name ``path``, which the user gave."""
    first = next(pictures)
    size = first.shape[1], first.shape[0]
    writer = ffmpeg.write_frames(
        str(place), size, fps=frames_per_second, quality=8, macro_block_size=2, ffmpeg_log_level="quiet"
    )
    count = 1
    writer.send(None)
    try:
        writer.send(first.tobytes())
        for picture in pictures:
            writer.send(picture.tobytes())
            count += 1
    except OSError as error:  # its text is several lines of ffmpeg output
        raise OutputLostError(path, "ffmpeg stopped") from error
    finally:
        writer.close()
    if not _holds(ffmpeg, place, count):
        raise OutputLostError(path, "ffmpeg did not write the whole file")


def _holds(ffmpeg: Any, path: Path, count: int) -> bool:
    """Whether a video can be read and has the expected number of frames: ffmpeg's exit code is not accessible."""
    try:
        return int(ffmpeg.count_frames_and_secs(str(path))[0]) == count
    except RuntimeError:
        return False
