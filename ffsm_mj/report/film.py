"""Animation of a run for display in a notebook."""

from __future__ import annotations

import html
from base64 import b64encode
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ffsm_mj.analysis.run import Run
from ffsm_mj.errors import InputError
from ffsm_mj.report.animation import gif
from ffsm_mj.report.frame_rate import MOST_FRAMES_PER_SECOND
from ffsm_mj.report.output_place import new_file, usable_file


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
    made, description = gif(run, frames_per_second=frames_per_second, speed=speed)
    return Film(run.name, description, made)
