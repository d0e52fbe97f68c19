"""The scene of a scenario at t = 0: sites, targets, centres of mass, reach and contacts, as text and for a viewer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.dynamics.reach import Reach, reach_of
from ffsm_mj.log.drawing import CheckedPair, InitialScene, NamedPoint
from ffsm_mj.model.system import System

_TURN = 2.0 * np.pi
_ROUNDED_M = 1e-5
"""Rounding of a target that was read off a model, m: templates write six decimals."""


def initial_scene(assembly: Assembly, lines: list[str]) -> InitialScene:
    """The scene of an assembly, for a viewer.

    Args:
        assembly: Components of a run at t = 0.
        lines: Text shown beside the scene.
    """
    system = assembly.system
    pairs = [CheckedPair(pair.name, pair.ids, pair.restitution, pair.mu) for pair in assembly.pairs]
    resolved = {frozenset(pair.geoms) for pair in pairs}
    return InitialScene(
        name=assembly.scenario.name,
        system=system,
        data=assembly.data,
        targets=list(_targets(assembly)),
        centres=list(_centres(system, assembly.data)),
        reaches=_reaches(assembly),
        pairs=pairs,
        ignored=assembly.known_pairs - resolved,
        lines=lines,
    )


def initial_lines(assembly: Assembly) -> list[str]:
    """Poses of sites, targets and centres of mass at t = 0, one line each, in world axes; and the reach of the arm."""
    system, data = assembly.system, assembly.data
    tips = _tips(assembly)
    rows = [
        (f"{'tip' if site in tips else 'site'} {system.mj.site(site).name}", data.site_xpos[site], _quaternion(data, site))
        for site in sorted(range(system.mj.nsite), key=lambda site: site not in tips)
    ]
    rows += [(point.name, point.point_m, "") for point in (*_targets(assembly), *_centres(system, data))]
    width = max(len(name) for name, *_ in rows)
    return [
        "  at t = 0 in world axes: x y z in m, quaternion w x y z",
        *(f"    {name:<{width}}  {_numbers(point, '8.4f')}  {turn}".rstrip() for name, point, turn in rows),
        *(f"  {_reach_line(reach)}" for reach in _reaches(assembly)),
    ]


def initial_notes(assembly: Assembly) -> Iterator[str]:
    """Initial values that are probably mistakes: hinges beyond one turn, a target beyond the reach of the arm."""
    for name, joint in assembly.system.joints.items():
        angle = float(assembly.data.qpos[joint.qpos][0])
        if joint.kind == "hinge" and abs(angle) > _TURN:
            as_degrees = f"{angle:g} degrees are {np.deg2rad(angle):.6g} rad"
            yield f"joint {name} starts at {angle:g} rad, {abs(angle) / _TURN:.3g} turns; angles are in rad, {as_degrees}"
    task = assembly.task
    reach = reach_of(assembly.system, assembly.data, task.tip_site) if task is not None else None
    if reach is None or task is None:
        return
    axes = list(task.axes)
    distance = float(np.linalg.norm(task.target_m - reach.centre_m[axes]))
    if distance > reach.radius_m + _ROUNDED_M:
        yield (
            f"the target is {distance:.4g} m from joint {reach.joint}, beyond the arm's reach of {reach.radius_m:.4g} m: "
            "the tip arrives only if the base moves"
        )


def _reach_line(reach: Reach) -> str:
    if not np.isfinite(reach.radius_m):
        return f"reach of {reach.tip}: unbounded, a slide joint after {reach.joint} has no limits"
    at = _numbers(reach.centre_m, ".4f")
    return (
        f"reach of {reach.tip}: at most {reach.radius_m:.4f} m from joint {reach.joint} at {at}, joint limits not considered"
    )


def _tips(assembly: Assembly) -> list[int]:
    """Ids of the sites of the robot that the task or a phase moves."""
    task = [] if assembly.task is None else [assembly.task.tip_site]
    laws = [law for phase in assembly.scenario.phases for law in phase.laws.values()]
    names = [getattr(law, "robot_site", None) for law in laws]
    return list(dict.fromkeys([*task, *(assembly.system.index("site", name) for name in names if name is not None)]))


def _reaches(assembly: Assembly) -> list[Reach]:
    found = (reach_of(assembly.system, assembly.data, site) for site in _tips(assembly))
    return [reach for reach in found if reach is not None]


def _targets(assembly: Assembly) -> Iterator[NamedPoint]:
    """Target of the task, at the height of the tip along axes that are not regulated, and sites that phases follow."""
    data, task = assembly.data, assembly.task
    if task is not None:
        point = data.site_xpos[task.tip_site].copy()
        point[list(task.axes)] = task.target_m
        yield NamedPoint("target of the tip", point)
    for phase in assembly.scenario.phases:
        for law in phase.laws.values():
            followed = getattr(law, "object_site", None)
            if followed is not None:
                site = assembly.system.index("site", followed)
                offset = data.site_xmat[site].reshape(3, 3) @ np.array(getattr(law, "offset_m", (0.0, 0.0, 0.0)))
                yield NamedPoint(f"target of {phase.name}", data.site_xpos[site] + offset)


def _centres(system: System, data: Any) -> Iterator[NamedPoint]:
    """Centres of mass of robot and objects, and of all that moves."""
    for tree in system.trees:
        yield NamedPoint(f"centre of mass of {tree.name}", data.subtree_com[tree.root].copy())
    if system.objects:
        masses = np.array([system.mj.body_subtreemass[tree.root] for tree in system.trees])
        points = np.array([data.subtree_com[tree.root] for tree in system.trees])
        yield NamedPoint("centre of mass of all", masses @ points / masses.sum())


def _quaternion(data: Any, site: int) -> str:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
    return _numbers(quaternion, "6.3f")


def _numbers(values: FloatArray, form: str) -> str:
    return " ".join(f"{value + 0.0:{form}}" for value in np.where(np.abs(values) < 5e-5, 0.0, values))
