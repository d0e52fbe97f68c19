"""Loads that the joints of a scenario do not determine, and its closed loops: of the models, and of grasps.

Those of grasps are considered at the initial state, where several of one object are closed together.
"""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.grasps import grasps_of
from ffsm_mj.contact_models.grasp.loops import closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.records import NEARLY_SINGULAR
from ffsm_mj.contact_models.joint_friction.coordinates import friction_coordinates
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import equalities_of
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.tolerances import MECHANISM_RANK

_NEAR = 1e-4
"""Least singular value over the largest below which it is noted; of 62 public robots the least is 8.5e-4."""


def loop_lines(assembly: Assembly) -> list[str]:
    """A heading, a line for equality constraints, and one for each object with grasps of several sites; none without any."""
    lines = _mechanism_lines(assembly)
    for grasps in _together(assembly):
        loops = _loops(assembly, grasps)
        rows, rank = loops.count, loops.weighted().rank
        names = " and ".join(grasp.name for grasp in grasps)
        lines.append(
            f"    {names}: {grasps[0].tree}, {rows} stopped motions of rank {rank}, mobility {assembly.system.mj.nv - rank}"
        )
    return ["  closed loops, at the initial state", *lines] if lines else []


def _mechanism_lines(assembly: Assembly) -> list[str]:
    """A line on the equality constraints of the models; none without any."""
    loops = _equalities(assembly)
    if loops is None:
        return []
    rank, nv, count = loops.weighted().rank, assembly.system.mj.nv, len(loops.sources)
    plural = "s" if count > 1 else ""
    return [f"    {count} equality constraint{plural}: {loops.count} rows of rank {rank}, mobility {nv - rank}"]


def _equalities(assembly: Assembly) -> ClosedLoops | None:
    system = assembly.system
    sources = [each.source for each in equalities_of(system.mj)]
    return ClosedLoops(system.mj, assembly.data, sources, rank=MECHANISM_RANK) if sources else None


def loop_notes(assembly: Assembly) -> Iterator[str]:
    """Loads that the joints do not determine, and mechanisms that are nearly singular."""
    equalities = _equalities(assembly)
    if equalities is not None and (ratio := equalities.weighted().least_ratio) < _NEAR:
        yield (
            f"the equality constraints are nearly singular at the initial state: least singular value {ratio:.1e} of the "
            "largest; forces are large"
        )
    for grasps in _together(assembly):
        loops = _loops(assembly, grasps)
        names, weighted = " and ".join(grasp.name for grasp in grasps), loops.weighted()
        if weighted.rank < loops.count:
            yield f"with {names} closed, the joints do not determine all loads: those of least norm are logged"
        if weighted.least_ratio < NEARLY_SINGULAR:
            yield (
                f"with {names} closed at the initial state, the mechanism is nearly singular: "
                f"least singular value {weighted.least_ratio:.1e} of the largest; loads are large"
            )


def friction_notes(assembly: Assembly) -> Iterator[str]:
    """Loads that dry friction leaves undetermined: where contacts or limits may press a joint that sticks as well."""
    on = friction_coordinates(assembly.system)
    if on is None:
        return
    stops = any(limit.joint in on.names and limit.restitution < 1.0 for limit in assembly.limits)
    if stops or any(pair.restitution < 1.0 for pair in assembly.contacts.pairs):
        yield (
            "where contacts or limits block a joint that its dry friction would hold as well, normal forces are not "
            "determined; by the convention idle_friction the friction is idle, and contacts and limits carry what they can"
        )


def _together(assembly: Assembly) -> list[list[Grasp]]:
    """Grasps of one object by different sites, the first one of the same two sites each."""
    found: dict[str, list[Grasp]] = {}
    for grasp in grasps_of(assembly.scenario, assembly.system):
        others = found.setdefault(grasp.tree, [])
        if not any(grasp.joins_sites_of(each) for each in others):
            others.append(grasp)
    return [grasps for grasps in found.values() if len(grasps) > 1]


def _loops(assembly: Assembly, grasps: list[Grasp]) -> ClosedLoops:
    """All of them as rows, with the bodies where they are at the initial state."""
    system, data = assembly.system, assembly.data
    latches = [loop_latch(system, grasp, closing_pose(system, data, grasp)) for grasp in grasps]
    return ClosedLoops(system.mj, data, latches)
