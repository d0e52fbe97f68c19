"""Contacts that press in a recording, and the load on a held object: arrows that end where they act, sizes over time."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from ffsm_mj.log.contact_forces import ForceColumns, force_columns
from ffsm_mj.log.drawing import Frames
from ffsm_mj.log.rerun.plots import BLUE, FORCES, GREEN, ORANGE, PURPLE, SKY, TORQUES, VERMILION
from ffsm_mj.records.signals import Layout

ARROW_M = (0.4, 1.5)
"""Drawn lengths of an arrow, m; between them 1 m is 1 N, or 1 N s of an impulse."""
_COLOURS = (GREEN, PURPLE, SKY, VERMILION, BLUE)
"""One for each pair, those of the lines among them."""


class Forces:
    """Sends the forces of pairs, and loads, from the first time on that they act."""

    def __init__(self, recording: rr.RecordingStream, layout: Layout) -> None:
        """Nothing has pressed yet."""
        self._recording, self._pairs = recording, force_columns(layout)
        self._pressed: list[str] = []

    def possible(self, *, torques: bool) -> list[str]:
        """Pairs that may last, and loads that may come: those of torques, or of forces."""
        return [pair.pair for pair in self._pairs if pair.turns == torques]

    def pressed(self, *, torques: bool) -> list[str]:
        """Those that have acted."""
        return [name for name in self._pressed if name in self.possible(torques=torques)]

    def send(self, frames: Frames, index: Any) -> None:
        """Send the arrows and sizes of some frames."""
        for pair in self._pairs:
            pressing = pair.pressing(frames.rows)
            if pair.pair not in self._pressed:
                if not pressing.any():
                    continue
                self._begin(pair)
            sizes = pair.sizes(frames.rows)
            shown = pressing & (sizes > 0.0)
            lengths = np.clip(sizes, *ARROW_M) / np.where(shown, sizes, 1.0)
            vectors = np.where(shown[:, None], lengths[:, None] * frames.rows[:, pair.vector], 0.0)
            origins = np.where(shown[:, None], frames.rows[:, pair.centre] - vectors, 0.0)
            self._columns(f"world/contacts/{pair.pair}", index, rr.Arrows3D.columns(origins=origins, vectors=vectors))
            self._columns(_line(pair), index, rr.Scalars.columns(scalars=sizes))

    def _begin(self, pair: ForceColumns) -> None:
        colour = ORANGE if pair.turns else _COLOURS[len(self._pressed) % len(_COLOURS)]
        self._pressed.append(pair.pair)
        look = rr.Arrows3D.from_fields(colors=[colour], radii=[0.03])
        self._recording.log(f"world/contacts/{pair.pair}", look, static=True)
        line = rr.SeriesLines(names=[pair.pair], colors=[colour], widths=[1.5])
        self._recording.log(_line(pair), line, static=True)

    def _columns(self, path: str, index: Any, columns: Any) -> None:
        rr.send_columns(path, indexes=index, columns=columns, recording=self._recording)


def _line(pair: ForceColumns) -> str:
    """Entity of a size over time."""
    return f"{TORQUES if pair.turns else FORCES}/{pair.pair}"
