"""Where bodies touch at the impacts of recordings, by the contact pairs of the scenario, and the impacts of each rule.

Velocities are those of mass centres and angular velocities in world axes where the bodies are free or move in a plane, so
that linear and angular momenta can be compared; of other mechanisms they are the rates of their joints.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.assembly.contact_rules import ContactRule, Contacts
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.proximity import Proximity
from ffsm_mj.contact_models.impact.resolution import Contact, contact_rows
from ffsm_mj.dynamics.rigid_body import mass_matrix, tangents
from ffsm_mj.errors import InputError
from ffsm_mj.identification.free_motion import Jump
from ffsm_mj.identification.impacts import MeasuredImpacts
from ffsm_mj.model.system import System, Tree

_ACROSS = 1e-9
"""Component of a unit vector along another one that is rounding."""
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Point:
    """A contact point of an impact.

    Attributes:
        pair: Name of the contact pair.
        position_m: World axes, (3,).
        normal: Unit normal from the first body to the second, world axes, (3,).
        gap_m: Gap of the pair at the recorded pose, m: how far poses and shapes are from each other.
    """

    pair: str
    position_m: FloatArray
    normal: FloatArray
    gap_m: float


@dataclass(frozen=True)
class RuleImpacts:
    """The impacts of a contact rule.

    Attributes:
        rule: The rule.
        impacts: Velocities and rows.
        axes: World axis of each linear velocity coordinate, ``x``, ``y`` or ``z``; empty for mechanisms.
        as_several: Whether the scene has several contact points there that are one for the motion, as both ends of an edge
            across its plane: impact laws then take their rule for several contacts.
        jumps: Where in the recordings each is.
        points: Their contact points.
    """

    rule: ContactRule
    impacts: MeasuredImpacts
    axes: tuple[str, ...]
    as_several: bool
    jumps: tuple[Jump, ...]
    points: tuple[Point, ...]


@dataclass(frozen=True)
class _One:
    """One impact: what :class:`MeasuredImpacts` stacks."""

    jump: Jump
    point: Point
    rule: str
    as_several: bool
    axes: tuple[str, ...]
    angular: tuple[int, ...]
    M: FloatArray
    rows: FloatArray
    before: FloatArray
    after: FloatArray

    @property
    def kind(self) -> tuple[object, ...]:
        """What impacts have in common that are stacked."""
        return self.axes, self.angular, self.rows.shape


class ContactPoints:
    """Finds the contact points of impacts."""

    def __init__(self, system: System, data: Any, contacts: Contacts, recorded: Sequence[Tree], reach_m: float) -> None:
        """Take the pairs of which both bodies were recorded or are fixed.

        Args:
            system: Robot and objects.
            data: Data of the system, changed.
            contacts: Contact rules with their pairs.
            recorded: Trees that were recorded.
            reach_m: Largest gap, or depth of an overlap, of bodies that touch by their recorded poses, m.

        Raises:
            InputError: No contact rule is between bodies that were recorded.
        """
        self._system, self._data, self._contacts, self._reach = system, data, contacts, reach_m
        self._left_out = Counter[str]()
        known = {body for tree in recorded for body in tree.bodies}
        seen = known | system.fixed_bodies
        self._pairs = [pair for pair in contacts.pairs if {pair.body_a, pair.body_b} <= seen]
        if not self._pairs:
            rules = "; ".join(f"{rule.name}: {' and '.join(rule.between)}" for rule in contacts.rules) or "none"
            names = ", ".join(tree.name for tree in recorded)
            raise InputError(f"no contact rule is between bodies that were recorded ({names}) or are fixed; rules: {rules}")

    def by_rule(self, jumps: Sequence[Jump]) -> tuple[list[RuleImpacts], Counter[str]]:
        """The impacts of each rule that has some, in the order of the rules, and why others are not used.

        Raises:
            InputError: A rule has impacts of bodies of different kinds.
        """
        self._left_out = Counter()
        every = [one for jump in jumps for one in self._of(jump)]
        stacked = []
        for rule in self._contacts.rules:
            some = [one for one in every if one.rule == rule.name]
            as_several = 2 * sum(one.as_several for one in some) > len(some)
            for one in some:
                if one.as_several != as_several:
                    self._leave_out("another number of contact points than at most impacts of the rule")
            some = [one for one in some if one.as_several == as_several]
            if len({one.kind for one in some}) > 1:
                raise InputError(
                    f"contacts.rules.{rule.name}: has impacts of bodies of different kinds; write a rule for each"
                )
            if some:
                stacked.append(_stacked(rule, some))
        return stacked, self._left_out

    def _leave_out(self, reason: str) -> None:
        self._left_out[reason] += 1

    def _of(self, jump: Jump) -> Iterator[_One]:
        """The impact of a jump of the velocities, if it is one of a single contact point."""
        model, data = self._system.mj, self._data
        data.qpos[:], data.qvel[:] = jump.qpos, jump.before
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        near = [(abs(pair.gap(model, data, 2.0 * self._reach)), k) for k, pair in enumerate(self._pairs)]
        gap, nearest = min(near)
        if gap > self._reach:
            self._leave_out(f"no bodies of a rule are within {1e3 * self._reach:g} mm of each other")
            return
        pair = self._pairs[nearest]
        proximity = min(pair.proximities(model, data), key=lambda one: one.gap)
        if proximity.rate >= 0.0:
            self._leave_out("the bodies do not approach at the contact point")
            return
        rows = [self._rows(pair, proximity, point) for point in proximity.points]
        # The ends of an edge across the plane of a motion have the same rows: for the motion they are one point.
        if any(np.abs(other - rows[0]).max() > _ACROSS * np.abs(rows[0]).max() for other in rows[1:]):
            self._leave_out("several contact points at once")
        else:
            yield self._measured(jump, pair, proximity, rows[0])

    def _rows(self, pair: ContactPair, near: Proximity, point: FloatArray) -> FloatArray:
        """Rows of the normal and two tangents in the velocities of the system, (3, nv)."""
        contact = Contact(pair.body_a, pair.body_b, point, near.normal)
        return contact_rows(self._system.mj, self._data, contact, tangents(near.normal))

    def _measured(self, jump: Jump, pair: ContactPair, near: Proximity, rows: FloatArray) -> _One:
        model, data = self._system.mj, self._data
        dofs, basis, axes, angular = self._coordinates(pair)
        rows = np.asarray(np.linalg.solve(basis.T, rows[:, dofs].T).T)
        if len(set(axes)) == 2:  # in a plane nothing moves along the tangent across it
            rows = rows[[0, 1 + int(np.argmax(np.linalg.norm(rows[1:], axis=1)))]]
        inverse = np.linalg.inv(basis)
        M = inverse.T @ mass_matrix(model, data)[np.ix_(dofs, dofs)] @ inverse
        point = Point(pair.name, near.points[0], near.normal, near.gap)
        several = len(near.points) > 1
        return _One(
            jump, point, pair.rule, several, axes, angular, M, rows, basis @ jump.before[dofs], basis @ jump.after[dofs]
        )

    def _coordinates(self, pair: ContactPair) -> tuple[IntArray, FloatArray, tuple[str, ...], tuple[int, ...]]:
        """Velocity coordinates of the bodies of a pair at the state in ``data``.

        Returns:
            Degrees of freedom, (n,), the matrix from their rates to the coordinates, (n, n), the world axes of the linear
            ones, and the places of the angular ones.
        """
        trees = [self._system.tree_of_body(body) for body in (pair.body_a, pair.body_b)]
        moving = list({tree.name: tree for tree in trees if tree is not None}.values())
        dofs = np.concatenate([np.arange(tree.dofs.start, tree.dofs.stop) for tree in moving])
        basis, axes, angular, at = np.zeros((len(dofs), len(dofs))), list[str](), list[int](), 0
        for tree in moving:
            twist = self._twist(tree)
            if twist is None:
                return dofs, np.eye(len(dofs)), (), ()
            block, along = twist
            basis[at : at + len(block), at : at + len(block)] = block
            axes += [axis for axis in along if axis]
            angular += [at + k for k, axis in enumerate(along) if not axis]
            at += len(block)
        return dofs, basis, tuple(axes), tuple(angular)

    def _twist(self, tree: Tree) -> tuple[FloatArray, tuple[str, ...]] | None:
        """Velocity of the mass centre and angular velocity of a rigid body per rates of its joints, world axes.

        Returns:
            The square matrix, and the world axis of each linear row, empty for angular ones; None for other mechanisms than
            a free body and one that moves in a plane of world axes.
        """
        model, data = self._system.mj, self._data
        if tree.dofs != tree.base_dofs:
            return None
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, linear, tree.root)
        mujoco.mj_jacBody(model, data, None, angular, tree.root)
        both = np.vstack((linear, angular))[:, tree.dofs]
        if both.shape[1] == 6:
            return both, (*_AXES, "", "", "")
        turning = np.flatnonzero(np.linalg.norm(both[3:], axis=1) > _ACROSS)
        if both.shape[1] != 3 or len(turning) != 1 or np.abs(both[turning[0]]).max() > _ACROSS:
            return None
        across = int(turning[0])
        in_plane = [k for k in range(3) if k != across]
        return both[[*in_plane, 3 + across]], (*(_AXES[k] for k in in_plane), "")


def _stacked(rule: ContactRule, some: Sequence[_One]) -> RuleImpacts:
    rows = np.array([one.rows for one in some])
    before, after = (np.array([getattr(one, name) for one in some]) for name in ("before", "after"))
    M = np.array([one.M for one in some])
    impacts = MeasuredImpacts(M, rows[:, 0], rows[:, 1:], before, after, some[0].angular, rule.compliance_ratio)
    first = some[0]
    return RuleImpacts(
        rule, impacts, first.axes, first.as_several, tuple(one.jump for one in some), tuple(one.point for one in some)
    )
