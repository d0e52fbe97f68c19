"""Animations of a run as GIF or MP4, in files and in notebooks, drawn without a display or GPU."""

from __future__ import annotations

import html
import math
from base64 import b64encode
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, MissingPackageError, OutputLostError, plural
from ffsm_mj.report import MOST_FRAMES_PER_SECOND
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


@dataclass(frozen=True)
class Film:
    """An animated GIF.

    Attributes:
        name: Name of the scenario.
        description: One line that describes it: frames, duration, playback speed.
        gif: Bytes of the file.
    """

    name: str
    description: str
    gif: bytes = field(repr=False)

    def save(self, path: str | Path) -> Path:
        """Write the file.

        Raises:
            InputError: The name does not end in ``.gif``, or the file cannot be written.
            OutputLostError: The file could not be written completely.
        """
        target = Path(path)
        if target.suffix.lower() != ".gif":
            raise InputError(f"{target}: must end in .gif; for .mp4 use 'ffsm export --mp4' on the command line")
        usable_file(target)
        with new_file(target) as place:
            place.write_bytes(self.gif)
        return target

    def _repr_html_(self) -> str:
        words = html.escape(f"{self.name}: {self.description}")
        return f'<img alt="{words}" title="{words}" src="data:image/gif;base64,{b64encode(self.gif).decode("ascii")}">'


# Values that are not finite show in the pictures; numpy's warnings would only repeat that.
@np.errstate(all="ignore")
def animate(run: Run, *, frames_per_second: float = 20.0, speed: float | None = None) -> Film:
    """Animation of the motion of a run, that of ``ffsm export --gif``; a notebook displays it, ``save(path)`` writes it.

    Args:
        run: The run.
        frames_per_second: Frame rate, up to 50.
        speed: Playback speed relative to real time; None: at most 12 s of video.

    Raises:
        InputError: The run has no samples, its models no longer compile, or the animation would be too long.
        ValueError: An invalid frame rate or speed.
    """
    if not 0.0 < frames_per_second <= MOST_FRAMES_PER_SECOND:
        raise ValueError(f"frames_per_second is {frames_per_second!r}; allowed: above 0, up to {MOST_FRAMES_PER_SECOND}")
    if speed is not None and not 0.0 < speed < float("inf"):
        raise ValueError(f"speed is {speed!r}; allowed: a positive number")
    cut = _cut(run, frames_per_second, speed, "", "raise speed or lower frames_per_second")
    with publication():
        return Film(run.name, cut.description, _gif(cut.pictures(), frames_per_second))


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
    pace = "in real time" if fast == 1.0 else f"at {fast:g} times real time"
    description = f"{plural(count, 'frame')}, {count / frames_per_second:.1f} s {pace}"
    return _Cut(Subject(run, times.tolist()), times, fast, description)


def _counted(pictures: Iterator[Any], count: int, report: Callable[[float, float], None] | None) -> Iterator[Any]:
    """The same frames, with progress reported after each."""
    for done, picture in enumerate(pictures, 1):
        if report is not None:
            report(done, count)
        yield picture


def _write_gif(path: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    with new_file(path) as place:
        place.write_bytes(_gif(pictures, frames_per_second))


def _gif(pictures: Iterator[Any], frames_per_second: float) -> bytes:
    images = [Image.fromarray(picture).quantize(64, Image.Quantize.FASTOCTREE) for picture in pictures]
    step = max(20, round(1000 / frames_per_second / 10) * 10)  # frame durations in GIF are in hundredths of a second
    durations = [step] * (len(images) - 1) + [round(1000 * _LAST_PICTURE_S)]
    buffer = BytesIO()
    images[0].save(buffer, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)
    return buffer.getvalue()


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
