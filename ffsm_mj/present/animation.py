"""The motion as a film for slides: the pictures of the strobe figure one after the other. No screen, no GPU."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import InputError, MissingPackageError, OutputLostError
from ffsm_mj.log.contact_forces import ForceColumns, force_columns
from ffsm_mj.present.output_place import usable_file, writing
from ffsm_mj.present.plots.motion import draw_plane, polygons, tree_colours, view_box
from ffsm_mj.present.plots.silhouette import Plane
from ffsm_mj.present.plots.style import BLACK, GREEN, YELLOW, publication
from ffsm_mj.present.plots.subject import Subject

_LONGEST_S = 12.0
_SPEEDS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)
_SIZE_PX = (960, 720)
_FLASH_S = 0.5
_ARROW = 0.12
"""Length of the arrow of a force, of the height of the picture."""
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
    """Write the motion of a run as ``.gif`` or ``.mp4``.

    Args:
        run: A run with at least one sample.
        path: The file; its suffix says which.
        frames_per_second: Pictures per second of the film.
        speed: Times real time; None: so that the film lasts 12 s at most.
        report: Told how many pictures of how many are drawn.

    Returns:
        What was written, for a person.

    Raises:
        InputError: No sample, models that do not compile any more, an unknown suffix, or a file that cannot be written to.
        OutputLostError: The film could not be written to its end.
        MissingPackageError: MP4 without imageio-ffmpeg.
    """
    writers = {".gif": _write_gif, ".mp4": _write_mp4}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: an animation is a .gif or an .mp4")
    usable_file(path)
    cut = _cut(run, frames_per_second, speed, f"{path}: ", "raise --speed or lower --fps")
    with publication():
        writers[path.suffix.lower()](path, cut.pictures(report), frames_per_second)
    return cut.said


def gif(run: Run, *, frames_per_second: float = 20.0, speed: float | None = None) -> tuple[bytes, str]:
    """The motion of a run as the bytes of an animated GIF, and what it is, for a person.

    Args:
        run: A run with at least one sample.
        frames_per_second: Pictures per second of the film.
        speed: Times real time; None: so that the film lasts 12 s at most.

    Raises:
        InputError: No sample, models that do not compile any more, or too many pictures.
    """
    cut = _cut(run, frames_per_second, speed, "", "raise speed or lower frames_per_second")
    held = BytesIO()
    with publication():
        _save_gif(held, cut.pictures(), frames_per_second)
    return held.getvalue(), cut.said


@dataclass(frozen=True)
class _Cut:
    """When in a run the pictures of a film are taken.

    Attributes:
        subject: The run.
        times: Of the pictures, s.
        speed: Times real time.
        said: What the film is, for a person.
    """

    subject: Subject
    times: FloatArray
    speed: float
    said: str

    def pictures(self, report: Callable[[float, float], None] | None = None) -> Iterator[Any]:
        """The pictures, drawn as they are asked for."""
        return _counted(_pictures(self.subject, self.times, self.speed), len(self.times), report)


def _cut(run: Run, frames_per_second: float, speed: float | None, place: str, way_on: str) -> _Cut:
    end = run.digest.end_s
    fast = speed or next((s for s in _SPEEDS if end / s <= _LONGEST_S), end / _LONGEST_S)
    wanted = end / fast * frames_per_second
    if not wanted < _MOST_PICTURES:
        amount = f"{end:g} s at {fast:g} times real time are {wanted:.3g} pictures"
        raise InputError(f"{place}{amount}, more than {_MOST_PICTURES}; {way_on}")
    count = max(2, 1 + math.ceil(wanted))
    times = np.linspace(0.0, end, count)
    said = f"{count} pictures, {count / frames_per_second:.1f} s at {fast:g} times real time"
    return _Cut(Subject(run, times.tolist()), times, fast, said)


def _counted(pictures: Iterator[Any], count: int, report: Callable[[float, float], None] | None) -> Iterator[Any]:
    """The same pictures; each that is done is told."""
    for done, picture in enumerate(pictures, 1):
        if report is not None:
            report(done, count)
        yield picture


def _pictures(subject: Subject, times: Any, speed: float) -> Iterator[Any]:
    """RGB pictures, (height, width, 3) uint8, at some simulation times."""
    run, plane = subject.run, subject.planes[0]
    rows = [min(int(np.searchsorted(run.time, time - 1e-9)), len(run.time) - 1) for time in times]
    box = view_box(subject, plane, rows[:: max(1, len(rows) // 40)])
    figure = Figure(figsize=_figure_size(box), dpi=120, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.subplots()
    draw_plane(axes, subject, plane, box)
    axes.set_title(" ", loc="left")
    figure.draw_without_rendering()  # the layout is made once and kept
    figure.set_layout_engine("none")
    trails = {name: axes.plot([], [], color=c, linewidth=1.2, zorder=20)[0] for name, c in tree_colours(subject).items()}
    trails["tip"] = axes.plot([], [], color=BLACK, linewidth=1.4, zorder=22)[0]
    star = axes.plot([], [], "*", markersize=16, markerfacecolor=YELLOW, markeredgecolor=BLACK, zorder=31)[0]
    marks, forces = run.log.marks(), force_columns(run.log.header.layout)
    paths = subject.roots | ({"tip": subject.tip} if subject.tip is not None else {})
    for row in rows:
        time = float(run.time[row])
        shapes = axes.add_collection(
            polygons(subject.silhouette.outlines(run.qpos[row], plane), subject, 0.8, 5), autolim=False
        )
        past = subject.chosen <= row
        for name, path in paths.items():
            trails[name].set_data(*path[past][:, plane.axes].T)
        hits = [np.array(mark.point_m)[plane.axes] for _, at, mark in marks if 0.0 <= time - at <= _FLASH_S * speed]
        pushes = axes.add_collection(_arrows(forces, np.asarray(run.log.rows[row : row + 1]), plane, box), autolim=False)
        star.set_data(*np.array(hits).reshape(-1, 2).T)
        axes.set_title(f"{_caption(run, time)}   ({speed:g}x)", loc="left")
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
        shapes.remove()
        pushes.remove()


def _arrows(forces: list[ForceColumns], row: FloatArray, plane: Plane, box: tuple[float, float, float, float]) -> Any:
    """Lines that end with a head where contacts press and grasps hold, along the force; all of one length."""
    length, drawn = _ARROW * (box[3] - box[2]), []
    for pair in forces:
        if not pair.turns and pair.pressing(row)[0]:
            end, push = row[0, pair.centre][plane.axes], row[0, pair.vector][plane.axes]
            along = length * push / max(float(np.hypot(*push)), 1e-300)
            across = 0.2 * np.array([-along[1], along[0]])
            drawn += [[end - along, end], [end - 0.3 * along + across, end, end - 0.3 * along - across]]
    return LineCollection(drawn, colors=GREEN, linewidths=2.2, zorder=30)


def _figure_size(box: tuple[float, float, float, float]) -> tuple[float, float]:
    """Inches, so that the picture fits the greatest size in pixels and both are even, as films need."""
    shape = (box[1] - box[0]) / (box[3] - box[2])
    width = min(_SIZE_PX[0], _SIZE_PX[1] * shape)
    return 2 * round(width / 2) / 120, 2 * round((width / shape + 60) / 2) / 120


def _caption(run: Run, time: float) -> str:
    phase = next((p.name for p in reversed(run.phases) if p.start_s <= time), "")
    return f"t = {time:6.2f} s   {phase.replace('_', ' ')}"


def _write_gif(path: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    held = BytesIO()
    _save_gif(held, pictures, frames_per_second)
    with writing(path):
        path.write_bytes(held.getvalue())


def _save_gif(to: BinaryIO, pictures: Iterator[Any], frames_per_second: float) -> None:
    images = [Image.fromarray(picture).quantize(64, Image.Quantize.FASTOCTREE) for picture in pictures]
    step = max(20, round(1000 / frames_per_second / 10) * 10)  # GIF counts hundredths of a second
    durations = [step] * (len(images) - 1) + [round(1000 * _LAST_PICTURE_S)]
    images[0].save(to, "GIF", save_all=True, append_images=images[1:], duration=durations, loop=0)


def _write_mp4(path: Path, pictures: Iterator[Any], frames_per_second: float) -> None:
    try:
        ffmpeg = import_module("imageio_ffmpeg")
    except ImportError as error:
        raise MissingPackageError("--mp4", "imageio-ffmpeg", "mp4") from error
    first = next(pictures)
    size = first.shape[1], first.shape[0]
    writer = ffmpeg.write_frames(
        str(path), size, fps=frames_per_second, quality=8, macro_block_size=2, ffmpeg_log_level="quiet"
    )
    count = 1
    writer.send(None)
    try:
        writer.send(first.tobytes())
        for picture in pictures:
            writer.send(picture.tobytes())
            count += 1
    except OSError as error:  # several lines of ffmpeg's
        raise OutputLostError(path, "ffmpeg stopped") from error
    finally:
        writer.close()
    if not _holds(ffmpeg, path, count):
        raise OutputLostError(path, "ffmpeg did not write it to its end")


def _holds(ffmpeg: Any, path: Path, count: int) -> bool:
    """Whether a film can be read and has so many pictures: ffmpeg's exit code is not to be had."""
    try:
        return int(ffmpeg.count_frames_and_secs(str(path))[0]) == count
    except RuntimeError:
        return False
