"""A run recomputed from the states in its log, with the models in its log.

Nothing that the log says of energies, momenta, work, limits or impacts is taken over. Every sample is the start of a flight
with the efforts that the log says acted, step by step as in the run: it must end at the next sample, or at the state before
the next impact. The books are kept on the way by the ledger that keeps them in a run, with the logged states at both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ffsm_mj.conservation import DEFAULT_TOLERANCE, Law, Tolerance, check_laws
from ffsm_mj.errors import InputError
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.recount.agreement import Difference
from ffsm_mj.recount.retrace import Retrace
from ffsm_mj.recount.scene import LogScene, log_scene
from ffsm_mj.signals import build_layout
from ffsm_mj.simulation import collected_warnings


@dataclass(frozen=True)
class Recount:
    """What the states of a log say.

    Attributes:
        log: The log, its energies, momenta and ledgers as its states say; as it was where nothing could be recomputed.
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: How many samples were recomputed.
        numbers: How many numbers were compared.
        gaps: Where samples do not follow each other by the control period; empty where they all do.
        obstacle: Why nothing could be recomputed; empty where it was.
    """

    log: RunLog
    worst: Mapping[str, Difference]
    samples: int = 0
    numbers: int = 0
    gaps: str = ""
    obstacle: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the log says what its states say; False where nothing could be recomputed."""
        return not self.obstacle and all(difference.holds for difference in self.worst.values())

    def laws(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
        """Every law, judged by what the states say; see :func:`ffsm_mj.conservation.check_laws`."""
        return check_laws(self.log, tolerance)


def recount(log: RunLog, report: Callable[[int], None] = lambda _: None) -> Recount:
    """Recompute a run from its log.

    Args:
        log: What was read.
        report: Told how many samples are done as it goes.
    """
    try:
        scene = log_scene(log)
        _refuse_other_columns(log, scene)
    except InputError as error:
        return Recount(log, {}, obstacle=error.lines[0])
    sampling = Sampling(
        scene.scenario.time_step_s * scene.scenario.steps_per_tick, [record.time_s for record in log.impacts]
    )
    retrace, rows, done = Retrace(scene, log), [], 0
    with collected_warnings([]):
        for block in log.blocks():
            rows.append(retrace.take(block, sampling.ticks(block[:, 0])))
            done += len(block)
            report(done)
        retrace.finish()
    sampling.end(log.outcome.end_s if log.outcome else None)
    found = {"motion": retrace.motion, "columns": retrace.columns, "impacts": retrace.impacts}
    return Recount(
        replace(log, rows=np.concatenate(rows) if rows else log.rows),
        {name: agreement.worst for name, agreement in found.items() if agreement.worst is not None},
        done,
        sum(agreement.numbers for agreement in found.values()),
        sampling.sentence(),
    )


def _refuse_other_columns(log: RunLog, scene: LogScene) -> None:
    """The columns must be those of these models.

    Raises:
        InputError: They are not.
    """
    layout = log.header.layout
    told = [signal for signal in layout.signals if signal.group == "controller"]
    expected = build_layout(scene.system, scene.actuation.signals, told, tip=scene.task is not None)
    if layout.keys != expected.keys:
        other = sorted(set(layout.keys) ^ set(expected.keys))
        raise InputError(f"the columns of the log are not those of its models: {', '.join(other[:3]) or 'another order'}")
