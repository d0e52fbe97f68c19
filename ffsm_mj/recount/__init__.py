"""A run recomputed from the states in its log, with the models in its log.

Nothing that the log says of energies, momenta, work, limits or impacts is taken over. Every sample is the start of a flight
with the efforts that the log says acted, step by step as in the run: it must end at the next sample, or at the state before
the next impact. The books are kept on the way by the ledger that keeps them in a run, with the logged states at both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ffsm_mj.conservation import DEFAULT_TOLERANCE, Audit, Law, Tolerance, audit
from ffsm_mj.errors import InputError
from ffsm_mj.events import ImpactRecord
from ffsm_mj.log.memory_sink import RunLog
from ffsm_mj.log.sampling import Sampling
from ffsm_mj.model import FloatArray
from ffsm_mj.mujoco_warnings import collected_warnings
from ffsm_mj.recount.agreement import Difference
from ffsm_mj.recount.retrace import Retrace
from ffsm_mj.recount.scene import LogScene, log_scene
from ffsm_mj.signals import PARTIES, build_layout


@dataclass(frozen=True)
class Recount:
    """What the states of a log say.

    Attributes:
        worst: Worst difference between the log and its states in ``motion``, ``columns`` and ``impacts``.
        samples: How many samples were recomputed.
        numbers: How many numbers were compared.
        gaps: Where samples do not follow each other by the control period; empty where they all do.
        obstacle: Why nothing could be recomputed; empty where it was.
    """

    worst: Mapping[str, Difference]
    samples: int
    numbers: int
    gaps: str
    obstacle: str
    _audit: Audit
    _impacts: tuple[ImpactRecord, ...]

    @property
    def agrees(self) -> bool:
        """Whether the log says what its states say; False where nothing could be recomputed."""
        return not self.obstacle and all(difference.holds for difference in self.worst.values())

    def laws(self, tolerance: Tolerance = DEFAULT_TOLERANCE) -> tuple[Law, ...]:
        """Every law by what the states say, or by what the log says where nothing could be recomputed.

        Args:
            tolerance: See :func:`ffsm_mj.conservation.check_laws`.
        """
        return self._audit.laws(self._impacts, tolerance)


def recount(
    log: RunLog,
    report: Callable[[float, float], None] | None = None,
    rows: Callable[[FloatArray], None] | None = None,
) -> Recount:
    """Recompute a run from its log.

    Args:
        log: What was read.
        report: Told (how many samples are done, of how many) as it goes.
        rows: Given the recomputed samples block by block, (n, number of signals).
    """
    try:
        scene = log_scene(log)
        _refuse_other_columns(log, scene)
    except InputError as error:
        return Recount({}, 0, 0, "", error.lines[0], audit(log), log.impacts)
    retrace = Retrace(scene, log)
    seen = Audit(log.header.layout, dict(log.header.facts) | _facts(scene, retrace))
    sampling = Sampling(scene.scenario.time_step_s * scene.scenario.steps_per_tick, (x.time_s for x in log.impacts))
    with collected_warnings([]):
        for block in log.blocks():
            again = retrace.take(block, sampling.ticks(block[:, 0]))
            seen.rows(again)
            if rows is not None:
                rows(again)
            if report is not None:
                report(seen.samples, max(scene.scenario.ticks + 1, seen.samples))
        retrace.finish()
    sampling.end(log.outcome.end_s if log.outcome else None)
    found = {"motion": retrace.motion, "columns": retrace.columns, "impacts": retrace.impacts}
    worst = {name: agreement.worst for name, agreement in found.items() if agreement.worst is not None}
    numbers = sum(agreement.numbers for agreement in found.values())
    return Recount(worst, seen.samples, numbers, sampling.sentence(), "", seen, log.impacts)


def _facts(scene: LogScene, retrace: Retrace) -> dict[str, str]:
    """What the models and the scenario say, whatever the log says of them."""
    free = {
        f"free_components_{party}": " ".join(f"{x:.0f}" for x in row)
        for party, row in zip(PARTIES, retrace.free, strict=True)
    }
    return free | {
        "conservative": "true" if not scene.system.faults else "false",
        "time_step_s": repr(scene.scenario.time_step_s),
    }


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
