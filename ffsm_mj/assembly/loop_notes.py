"""Closed loops that the grasps of a scenario make where they are closed together: their rank at the initial state."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.grasps import grasps_of
from ffsm_mj.contact_models.grasp.loop_latch import closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.record_kinds import NEARLY_SINGULAR
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.model.grasp import Grasp


def loop_lines(assembly: Assembly) -> list[str]:
    """A heading and a line for each object with grasps of several sites; none if there is none."""
    lines = []
    for grasps in _together(assembly):
        loops = _loops(assembly, grasps)
        rows, rank = loops.count, loops.weighted().rank
        names = " and ".join(grasp.name for grasp in grasps)
        lines.append(
            f"    {names}: {grasps[0].tree}, {rows} stopped motions of rank {rank}, mobility {assembly.system.mj.nv - rank}"
        )
    return ["  grasps that close loops together, at the initial state", *lines] if lines else []


def loop_notes(assembly: Assembly) -> Iterator[str]:
    """Loads that the joints do not determine, and mechanisms that are nearly singular."""
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
