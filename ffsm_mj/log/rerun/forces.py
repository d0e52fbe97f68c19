"""Arrows of forces and torques in a recording, and plots of their magnitudes."""

from __future__ import annotations

from typing import Any

import rerun as rr

from ffsm_mj.log.arrows import arrow_series, declared_arrows
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.palette import BLUE, FORCE, PURPLE, SKY, TORQUE, VERMILION
from ffsm_mj.log.rerun.plots import FORCES, TORQUES
from ffsm_mj.records.arrows import ArrowColumns
from ffsm_mj.records.header import RunHeader

_COLOURS = (FORCE, PURPLE, SKY, VERMILION, BLUE)
"""Colours of forces and their curves in turn; torques have one of their own."""


class Forces:
    """Sends the arrows that contact models declare; an entity is created when its arrow first acts."""

    def __init__(self, recording: rr.RecordingStream, header: RunHeader, scale: float) -> None:
        """Start without entities, at a scale of markers."""
        self._scale = scale
        self._recording, self._declared = recording, declared_arrows(header)
        self._begun: list[ArrowColumns] = []

    def possible(self, *, torques: bool) -> list[str]:
        """Names of all declared forces, or torques."""
        return [arrow.name for arrow in self._declared if arrow.is_torque == torques]

    def begun(self, *, torques: bool) -> list[str]:
        """Names of the forces, or torques, that have acted."""
        return [arrow.name for arrow in self._begun if arrow.is_torque == torques]

    def send(self, frames: Frames, index: Any) -> None:
        """Send arrows and magnitudes of some frames."""
        for arrow in self._declared:
            series = arrow_series(arrow, frames.rows, self._scale)
            if arrow not in self._begun:
                if not series.acts.any():
                    continue
                self._begin(arrow)
            arrows = rr.Arrows3D.columns(origins=series.origins, vectors=series.vectors)
            self._columns(f"world/contacts/{arrow.name}", index, arrows)
            self._columns(_plot(arrow), index, rr.Scalars.columns(scalars=series.sizes))

    def _begin(self, arrow: ArrowColumns) -> None:
        colour = TORQUE if arrow.is_torque else _COLOURS[len(self._begun) % len(_COLOURS)]
        self._begun.append(arrow)
        look = rr.Arrows3D.from_fields(colors=[colour], radii=[0.03 * self._scale])
        self._recording.log(f"world/contacts/{arrow.name}", look, static=True)
        line = rr.SeriesLines(names=[arrow.name], colors=[colour], widths=[1.5])
        self._recording.log(_plot(arrow), line, static=True)

    def _columns(self, path: str, index: Any, columns: Any) -> None:
        rr.send_columns(path, indexes=index, columns=columns, recording=self._recording)


def _plot(arrow: ArrowColumns) -> str:
    """Entity of a magnitude over time."""
    return f"{TORQUES if arrow.is_torque else FORCES}/{arrow.name}"
