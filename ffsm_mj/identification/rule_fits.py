"""Restitution and friction of the contact rules of a scenario from recordings: what ``ffsm fit`` computes.

The chain: recordings, impacts where velocities jump, their contact points, the test of the frame, and the law of the
scenario fitted to the impacts of each rule. Whatever cannot be used is counted with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.identification.contact_points import ContactPoints, RuleImpacts
from ffsm_mj.identification.fit import LawFit, fit, predicted
from ffsm_mj.identification.frames import RECORDED, balances, mirrors_of, refuse_mirrored
from ffsm_mj.identification.free_motion import JumpSearch
from ffsm_mj.identification.impacts import LeastErrors, least_errors, moment_balance
from ffsm_mj.identification.recording import Kind, read_recordings
from ffsm_mj.model.system import Joint
from ffsm_mj.records.signals import rate_names

NEEDED = 8
"""Impacts of a rule that a fit needs: four times its two numbers, so that a bootstrap has something to resample."""
SLIDING = 4
"""Impacts that must slide to the end by the fit for it to say what mu is: those that stick have no part in it."""
REACH_M = 5e-3
"""Largest gap at which bodies touch: markers are placed, and shapes made, to some millimetres."""
_ONE_POINT = 0.3
"""Least error of any impulse through the contact point from which on there was another contact too: the energy of what is
not explained is a tenth of all."""
_STEP, _DEPENDS = 1e-3, 1e-3
"""Relative change of mu that tells whether an impact depends on it, and the least change of its velocities, in units of that
change and of the velocities before."""
_RULES_OF_LAWS = {("blend", True): "coulomb", ("poisson", True): "poisson", ("poisson", False): "stronge"}
"""Rules of the built-in laws by law, and by whether there are several contact points; others are known by the law."""


@dataclass(frozen=True)
class RuleFit:
    """The fit of a contact rule.

    Attributes:
        of: The impacts that it is made of.
        law: The fitted law; None: there are too few impacts.
        slides: Whether each impact slides to the end by the fit, (k,).
        least: Least errors of any impulse through the contact points.
        velocities: Velocities after by the fitted law, (k, n); those before if there is none.
        r_squared: R^2 of the moment balance by frame: as recorded, and mirrored.
    """

    of: RuleImpacts
    law: LawFit | None
    slides: BoolArray
    least: LeastErrors
    velocities: FloatArray
    r_squared: Mapping[str, float]

    @property
    def is_mu_known(self) -> bool:
        """Whether enough impacts slide; if not, mu is any that lets them stick."""
        return self.sliding >= SLIDING

    @property
    def sliding(self) -> int:
        """Number of impacts that slide to the end."""
        return int(np.count_nonzero(self.slides))

    @property
    def errors(self) -> FloatArray:
        """Errors of the fitted law in the norm of the kinetic energy, relative to the velocities before, (k,)."""
        return self.of.impacts.errors(self.velocities)


@dataclass(frozen=True)
class Fits:
    """The fits of all rules with impacts.

    Attributes:
        rules: By rule, in the order of the scenario.
        law: Name of the impact law.
        left_out: Why impacts are not used, with their number.
        noise: Standard deviation of the recorded coordinates, with their names; empty for velocities.
        fall: Acceleration of free fall in the flights over that of the scenario; None without gravity, and for velocities.
    """

    rules: tuple[RuleFit, ...]
    law: str
    left_out: Mapping[str, int]
    noise: Mapping[str, float]
    fall: float | None


def fit_recordings(
    paths: Sequence[Path],
    prepared: PreparedRun,
    kind: Kind | None = None,
    run_column: str | None = None,
    reach_m: float = REACH_M,
) -> Fits:
    """Fit restitution and friction of the contact rules of a scenario to recordings.

    Args:
        paths: CSV or Parquet files.
        prepared: The scenario.
        kind: ``poses`` or ``velocities``; None: velocities if there are columns of them.
        run_column: Column that tells runs of one file apart; None: ``run``, if there is one.
        reach_m: Largest gap, or depth of an overlap, at which bodies touch by their recorded poses, m.

    Raises:
        InputError: A recording cannot be read, the scenario is not one of free flights, the frame is mirrored, or there are
            too few impacts.
    """
    assembly = prepared.assemble()
    system, data = assembly.system, assembly.data
    _refuse_other_motion(prepared)
    recordings = read_recordings(paths, system, np.array(data.qpos), kind, run_column)
    points = ContactPoints(system, data, assembly.contacts, recordings.trees, reach_m)
    jumps = JumpSearch(system.mj, recordings).jumps()
    mirrors = mirrors_of(system, recordings.trees, with_velocities=not len(jumps.noise))
    r_squared = balances(points, jumps.impacts, mirrors, NEEDED)
    refuse_mirrored(", ".join(map(str, paths)), r_squared)
    stacked, not_used = points.by_rule(jumps.impacts)
    left_out = Counter(jumps.left_out) + not_used
    fits = []
    for of in stacked:
        single = least_errors(of.impacts).errors <= _ONE_POINT
        if not single.all():
            left_out["no impulse through one contact point explains it"] += int(np.count_nonzero(~single))
        law, of_rule, used = prepared.scenario.impact.law, r_squared.get(of.rule.name, {}), chosen(of, single)
        if of_rule and single.any():
            of_rule[RECORDED] = moment_balance(used.impacts).r_squared
        fits.append(fit_rule(used, law, of_rule))
    if not any(one.law is not None for one in fits):
        raise InputError(_too_few(paths, fits, left_out))
    names = [name for tree in recordings.trees for name in _names(tree.joints)]
    noise = dict(zip(names, jumps.noise[recordings.dofs].tolist(), strict=True)) if len(jumps.noise) else {}
    return Fits(tuple(fits), prepared.scenario.impact.law, left_out, noise, jumps.fall)


def _refuse_other_motion(prepared: PreparedRun) -> None:
    """Refuse scenes whose motion between impacts is not that of their models alone, or whose impacts move closed loops.

    Raises:
        InputError: It is one.
    """
    around = prepared.scenario.environment
    if around is not None and (around.fields or around.orbit is not None):
        raise InputError("environment: fits are of free falls and of motions without forces; leave out fields and orbit")
    if prepared.system.equalities:
        places = ", ".join(prepared.system.equalities.values())
        raise InputError(f"fits have no equality constraints; leave out {places}")


def _names(joints: Sequence[Joint]) -> Iterator[str]:
    """Names of the displacements of joints, in the order of their rates: those of rotations are angles."""
    for joint in joints:
        for name in rate_names(joint):
            yield (
                name.removesuffix("_s")
                .replace("_wx_", "_rx_")
                .replace("_wy_", "_ry_")
                .replace("_wz_", "_rz_")
                .replace("_v", "_")
            )


def chosen(of: RuleImpacts, which: BoolArray) -> RuleImpacts:
    """Some of the impacts of a rule."""
    places = np.flatnonzero(which).tolist()
    jumps, points = tuple(of.jumps[k] for k in places), tuple(of.points[k] for k in places)
    return replace(of, impacts=of.impacts.select(which), jumps=jumps, points=points)


def fit_rule(of: RuleImpacts, law: str, r_squared: Mapping[str, float]) -> RuleFit:
    """The fit of a law to the impacts of a rule, if there are enough.

    Args:
        of: The impacts.
        law: Name of the impact law of the scenario.
        r_squared: R^2 of the moment balance by frame.

    Raises:
        InputError: The law does not cover friction.
    """
    impacts = of.impacts
    if len(impacts) < NEEDED:
        return RuleFit(of, None, np.zeros(len(impacts), dtype=np.bool_), least_errors(impacts), impacts.before, r_squared)
    try:
        rule = _RULES_OF_LAWS.get((law, of.as_several), law)
        fitted = fit(impacts, rule)
        mu, e = fitted.mu.value, fitted.e.value
        velocities = predicted(impacts, rule, mu, e)
        other = predicted(impacts, rule, mu * (1.0 + _STEP), e)
    except UnsupportedContactError as error:
        raise InputError(f"impact.law: {error}") from error
    # What sticks at the end depends on mu to no order; what slides does to the first.
    moved = np.linalg.norm(impacts.weighted(other - velocities), axis=1)
    return RuleFit(of, fitted, moved > _DEPENDS * _STEP * impacts.speeds, least_errors(impacts), velocities, r_squared)


def _too_few(paths: Sequence[Path], fits: Sequence[RuleFit], left_out: Mapping[str, int]) -> str:
    """Sentence that says how many impacts there are, why others were left out, and how many are needed."""
    counts = ", ".join(f"{one.of.rule.name}: {len(one.of.jumps)}" for one in fits) or "none"
    why = "; ".join(f"{reason}: {number}" for reason, number in left_out.items())
    files = ", ".join(map(str, paths))
    return f"{files}: too few impacts, {NEEDED} of a rule are needed; found {counts}" + (f"; left out: {why}" if why else "")
