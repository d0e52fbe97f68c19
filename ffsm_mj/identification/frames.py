"""Whether the momenta of recorded impacts say that an axis or the sense of rotation of the recording is reversed.

A frame of the other handedness, or an axis that points the other way in the velocities alone, leaves flights, energies and
normal velocities as they are. That the moment of the impulse about the mass centre is the change of angular momentum shows
it: :func:`~ffsm_mj.identification.impacts.moment_balance` of the impacts as recorded and mirrored, each with the contact
points of its own poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.dynamics.rigid_body import rotation_matrix
from ffsm_mj.errors import InputError
from ffsm_mj.identification.contact_points import ContactPoints
from ffsm_mj.identification.free_motion import Jump
from ffsm_mj.identification.impacts import moment_balance
from ffsm_mj.model.system import Joint, System, Tree

RECORDED = "as recorded"
_OBEYED, _SHARE = 0.5, 0.5
"""R^2 of the moment balance that a mirrored frame has at least, and the most that it leaves of what the frame as recorded
does not explain. Where friction is low most of a moment is of the normal impulse, which no mirror along the surface changes:
0.99 and 0.82 of cubes with mu = 0.15. Noise is the same in both, and mirrors of the right frame only add to it."""
_ALONG = 1.0 - 1e-9
"""Component of the axis of a slide along a world axis from which on it is along it."""

Mirror = Callable[[Jump], Jump]


def balances(
    points: ContactPoints, jumps: Sequence[Jump], mirrors: Mapping[str, Mirror], least: int
) -> dict[str, dict[str, float]]:
    """R^2 of the moment balance by rule and frame, where enough impacts are of bodies that turn.

    Args:
        points: Finds the contact points.
        jumps: The impacts.
        mirrors: Frames by name; see :func:`mirrors_of`.
        least: Impacts that are enough.
    """
    by_rule: dict[str, dict[str, float]] = {}
    for name, mirror in mirrors.items():
        for of in points.by_rule([mirror(jump) for jump in jumps])[0]:
            if len(of.jumps) >= least and of.impacts.angular and of.impacts.linear:
                by_rule.setdefault(of.rule.name, {})[name] = moment_balance(of.impacts).r_squared
    return by_rule


def refuse_mirrored(place: str, by_rule: Mapping[str, Mapping[str, float]]) -> None:
    """Refuse recordings in a mirrored frame.

    Args:
        place: Their files.
        by_rule: See :func:`balances`.

    Raises:
        InputError: The momenta obey a mirror, and not the frame as recorded.
    """
    for rule, r_squared in by_rule.items():
        best = max(r_squared, key=lambda name: r_squared[name])
        recorded = r_squared.get(RECORDED, -np.inf)
        if r_squared[best] > _OBEYED and 1.0 - r_squared[best] < _SHARE * (1.0 - recorded):
            has = f"(R2 {recorded:.3g})" if RECORDED in r_squared else "(hardly any bodies touch)"
            raise InputError(
                f"{place}: the frame is mirrored: at impacts of {rule} changes of angular momentum agree with moments of "
                f"impulses {best} (R2 {r_squared[best]:.3g}), not {RECORDED} {has}; reverse these columns"
            )


def mirrors_of(system: System, trees: Sequence[Tree], *, with_velocities: bool) -> dict[str, Mirror]:
    """Frames to compare: as recorded, with each axis and with rotation reversed; for mechanisms the first alone.

    Args:
        system: Robot and objects.
        trees: Trees that were recorded.
        with_velocities: Velocities were recorded too: they may be reversed alone.
    """
    mirrors: dict[str, Mirror] = {RECORDED: lambda jump: jump}
    if any(tree.dofs != tree.base_dofs for tree in trees):
        return mirrors
    joints = [joint for tree in trees for joint in tree.joints]
    for axis, name in enumerate("xyz"):
        places = np.array([place for joint in joints for place in _along(system.mj, joint, axis)], dtype=np.intp).reshape(
            -1, 2
        )
        if len(places):
            mirrors[f"with {name} reversed"] = _reversing(places[:, 0], places[:, 1])
            if with_velocities:
                mirrors[f"with {name} reversed in the velocities"] = _reversing(places[:0, 0], places[:, 1])
    mirrors["with rotation reversed"] = lambda jump: _turned_back(jump, joints)
    if with_velocities:
        turning = [joint.dofs.stop - 3 + k for joint in joints if joint.kind == "free" for k in range(3)]
        turning += [joint.dofs.start for joint in joints if joint.kind == "hinge"]
        mirrors["with rotation reversed in the velocities"] = _reversing(
            np.zeros(0, dtype=np.intp), np.array(turning, dtype=np.intp)
        )
    return mirrors


def _along(model: Any, joint: Joint, axis: int) -> Iterator[tuple[int, int]]:
    """Places in ``qpos`` and ``qvel`` of a coordinate of a base joint along a world axis; bases have parents at rest."""
    if joint.kind == "free":
        yield joint.qpos.start + axis, joint.dofs.start + axis
    elif joint.kind == "slide" and abs(float(model.jnt_axis[model.joint(joint.name).id][axis])) > _ALONG:
        yield joint.qpos.start, joint.dofs.start


def _reversing(coordinates: IntArray, rates: IntArray) -> Mirror:
    """A mirror that changes the sign of some coordinates and velocities."""

    def mirrored(jump: Jump) -> Jump:
        qpos, before, after = jump.qpos.copy(), jump.before.copy(), jump.after.copy()
        qpos[coordinates] *= -1.0
        before[rates] *= -1.0
        after[rates] *= -1.0
        return replace(jump, qpos=qpos, before=before, after=after)

    return mirrored


def _turned_back(jump: Jump, joints: Sequence[Joint]) -> Jump:
    """The impact with rotations inverted, R^T for R, whose body rates are then -R omega."""
    qpos, velocities = jump.qpos.copy(), [jump.before.copy(), jump.after.copy()]
    for joint in joints:
        if joint.kind == "hinge":
            qpos[joint.qpos] *= -1.0
            for qvel in velocities:
                qvel[joint.dofs] *= -1.0
        elif joint.kind == "free":
            quaternion, rates = slice(joint.qpos.stop - 4, joint.qpos.stop), slice(joint.dofs.stop - 3, joint.dofs.stop)
            R = rotation_matrix(qpos[quaternion])
            qpos[quaternion] *= (1.0, -1.0, -1.0, -1.0)
            for qvel in velocities:
                qvel[rates] = -R @ qvel[rates]
    return replace(jump, qpos=qpos, before=velocities[0], after=velocities[1])
