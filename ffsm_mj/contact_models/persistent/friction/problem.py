"""Contact forces with Coulomb friction in given modes, at the level of accelerations.

With rows (n, t1, t2) of k contact points, M the mass matrix and f all forces except those of the contacts,

    a = b + G lambda,   G = J M^-1 J^T,   b = J M^-1 f + gamma

is the relative acceleration of the two bodies at each point, in the normal row the second rate of the gap. A sticking point
has a = 0 in its three rows; a sliding one has a_n = 0 and lambda_t = -mu lambda_n s with the direction of slip s. With R the
rows that are held and D those along which forces act, the conditions R are linear in the forces (Pfeiffer & Glocker,
*Multibody Dynamics with Unilateral Contacts*).

Rows of redundant points are dependent. Forces are then those of equal springs at all points: they lie in the range of R M^-1
R^T, which is the least norm without friction and for points that stick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray
from ffsm_mj.contact_models.persistent.friction.modes import Mode
from ffsm_mj.tolerances import CANCELLED, EPSILON, RANK

_TURNS = 50
_LARGEST_TURN = 0.5
"""Newton steps for the directions of slip are at most this long, rad."""
_TURNED = 1e-14
"""Newton's method ends at steps below this, rad."""


@dataclass(frozen=True)
class OwnVelocity:
    """Velocities at the contact points that depend on the forces sought: force_free + steps_s * G lambda.

    Attributes:
        force_free: Velocity (n, t1, t2) at each point without contact forces, m/s, (3k,).
        steps_s: Time for which the contact forces act: for a stage of an implicit method its duration times the diagonal
            coefficient of the method, s, (3k,).
        free: Sliding points whose direction of slip follows from this velocity; that of the others is given.
    """

    force_free: FloatArray
    steps_s: FloatArray
    free: IntArray


class FrictionProblem:
    """The contact problem of k points at one state.

    Attributes:
        G: Delassus matrix of rows (n, t1, t2) of each point, 1/kg, (3k, 3k).
        b: Accelerations without contact forces, m/s^2, (3k,).
        mu: Coefficients of friction, (k,).
        inverse_mass: Inverse mass along each normal, 1/kg, (k,).
        movable_normals: Points at which a normal force can move anything, (k,).
    """

    def __init__(self, G: FloatArray, b: FloatArray, mu: FloatArray) -> None:
        """Set up the problem."""
        self.G, self.b, self.mu = G, b, mu
        diagonal = G.diagonal().reshape(-1, 3)
        self._movable: BoolArray = diagonal > CANCELLED * max(1.0, float(diagonal.max(initial=0.0)))
        self.inverse_mass: FloatArray = diagonal[:, 0]
        self.movable_normals: BoolArray = self._movable[:, 0]

    def held_rows(self, kinds: IntArray) -> IntArray:
        """Rows held by points in given modes; rows along which nothing can move are left out."""
        held = np.zeros((len(kinds), 3), dtype=np.bool_)
        held[:, 0] = kinds != Mode.CLOSED
        held[:, 1:] = (kinds == Mode.STICK)[:, None]
        return np.flatnonzero((held & self._movable).ravel())

    def rank(self, kinds: IntArray) -> int:
        """Number of independent rows held in given modes."""
        rows = self.held_rows(kinds)
        if not len(rows):
            return 0
        sizes = np.linalg.eigvalsh(self.G[np.ix_(rows, rows)])
        return int(np.count_nonzero(sizes > RANK * sizes[-1]))

    def forces(self, kinds: IntArray, slips: FloatArray, rank: int) -> FloatArray:
        """Forces (n, t1, t2) of each point in given modes, N, (k, 3).

        Args:
            kinds: Modes, (k,).
            slips: Unit direction of slip of each sliding point along (t1, t2), (k, 2); zero without friction.
            rank: Number of independent rows.
        """
        return _Held(self, kinds, rank).forces(slips)

    def forces_along_slip(
        self, kinds: IntArray, slips: FloatArray, rank: int, velocity: OwnVelocity
    ) -> tuple[FloatArray, FloatArray]:
        """The same where some directions of slip are those of velocities that the forces themselves determine.

        Newton's method on the angles of these directions.

        Args:
            kinds: Modes, (k,).
            slips: Directions, and for points that are free a first estimate, (k, 2).
            rank: Number of independent rows.
            velocity: The velocities.

        Returns:
            Forces, N, (k, 3), and directions, (k, 2).
        """
        held, free, slips = _Held(self, kinds, rank), velocity.free, slips.copy()
        angles = np.arctan2(slips[free, 1], slips[free, 0])
        forces = held.forces(slips)
        for _ in range(_TURNS):
            step = self._turn(held, forces, slips[free], velocity)
            largest = float(np.abs(step).max(initial=0.0))
            angles = angles + step * min(1.0, _LARGEST_TURN / max(largest, _LARGEST_TURN))
            slips[free] = np.stack((np.cos(angles), np.sin(angles)), axis=1)
            forces = held.forces(slips)
            if largest <= _TURNED:
                break
        return forces, slips

    def _turn(self, held: _Held, forces: FloatArray, s: FloatArray, velocity: OwnVelocity) -> FloatArray:
        """Newton step for the angles of the free directions, rad: each is to be the angle of its velocity."""
        free, steps = velocity.free, velocity.steps_s
        u = (velocity.force_free + steps * (self.G @ forces.ravel())).reshape(-1, 3)[free, 1:]
        across = np.stack((-s[:, 1], s[:, 0]), axis=1)
        miss = np.arctan2(np.sum(across * u, axis=1), np.sum(s * u, axis=1))
        square = np.sum(u * u, axis=1)
        turn = np.stack((-u[:, 1], u[:, 0]), axis=1) / np.where(square > 0.0, square, 1.0)[:, None]
        slopes = -np.eye(len(free))
        for j, i in enumerate(free.tolist()):
            answer = held.response_to_turn(i, across[j], float(forces[i, 0]))
            change = (steps * (self.G @ answer.ravel())).reshape(-1, 3)[free, 1:]
            slopes[:, j] += np.sum(turn * change, axis=1)
        return np.asarray(np.linalg.lstsq(slopes, -miss, rcond=None)[0])

    def lines(self) -> tuple[BoolArray, FloatArray]:
        """Points that can slip along one line only, (k,), and the unit vector along it, (k, 2); arbitrary for the others.

        A point slips along a line if its two tangent rows of G have rank one, as in a planar mechanism.
        """
        count = len(self.mu)
        blocks = self.G.reshape(count, 3, count, 3)[np.arange(count), 1:, np.arange(count), 1:]
        sizes, axes = np.linalg.eigh(blocks)
        return sizes[:, 0] <= RANK * sizes[:, 1], axes[:, :, 1]

    def tangent_inertia(self) -> FloatArray:
        """Largest eigenvalue of the two tangent rows of G of each point, 1/kg, (k,)."""
        count = len(self.mu)
        blocks = self.G.reshape(count, 3, count, 3)[np.arange(count), 1:, np.arange(count), 1:]
        return np.asarray(np.linalg.eigvalsh(blocks)[:, 1])

    def virtual_shares(self, kinds: IntArray, forces: FloatArray, rank: int) -> FloatArray:
        """Normal forces of springs like those of the held points, at points without force, N, (k,); zero at the others."""
        rows = self.held_rows(kinds)
        closed = np.flatnonzero(kinds == Mode.CLOSED)
        shares = np.zeros(len(kinds))
        if len(rows) and len(closed):
            sizes, U = np.linalg.eigh(self.G[np.ix_(rows, rows)])
            kept = slice(len(rows) - rank, None)
            displacement = U[:, kept] @ ((U[:, kept].T @ forces.ravel()[rows]) / sizes[kept])
            shares[closed] = self.G[np.ix_(3 * closed, rows)] @ displacement
        return shares


class _Held:
    """The rows held by points in given modes, with the linear problem for their forces."""

    def __init__(self, problem: FrictionProblem, kinds: IntArray, rank: int) -> None:
        self._problem, self._kinds = problem, kinds
        self._rows = rows = problem.held_rows(kinds)
        self._held_G = problem.G[rows]
        self._range = None
        if rank < len(rows):
            self._range = np.linalg.eigh(self._held_G[:, rows])[1][:, len(rows) - rank :]
        self._along = np.zeros((3 * len(kinds), len(rows)))
        self._along[rows, np.arange(len(rows))] = 1.0
        self._column = {int(row) // 3: j for j, row in enumerate(rows) if row % 3 == 0}

    def forces(self, slips: FloatArray) -> FloatArray:
        """Forces (n, t1, t2) of each point for given directions of slip, N, (k, 3)."""
        mu = self._problem.mu
        for i, j in self._column.items():
            if self._kinds[i] == Mode.SLIDE:
                self._along[3 * i + 1 : 3 * i + 3, j] = -mu[i] * slips[i]
        return (self._along @ self._solve(-self._problem.b[self._rows])).reshape(-1, 3)

    def _solve(self, right: FloatArray) -> FloatArray:
        if not len(right):
            return right
        system = self._held_G @ self._along
        if self._range is None:
            return _solved(system, right)
        U = self._range
        return np.asarray(U @ _solved(U.T @ system @ U, U.T @ right))

    def response_to_turn(self, point: int, across: FloatArray, normal_force: float) -> FloatArray:
        """Change of all forces per rad by which the direction of slip of one point turns, (k, 3)."""
        turned = np.zeros((len(self._kinds), 3))
        turned[point, 1:] = -self._problem.mu[point] * normal_force * across
        answer = self._solve(-(self._held_G @ turned.ravel()))
        return turned + (self._along @ answer).reshape(-1, 3)


def _solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solution of linear equations; large where they are singular, as at the limit of Painleve's paradox."""
    try:
        return np.asarray(np.linalg.solve(system, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(system, right, rcond=EPSILON)[0])


def unit_slips(velocities: FloatArray) -> FloatArray:
    """Unit vectors along slip velocities, (k, 2); zero where there is none."""
    sizes = np.array([math.hypot(*each) for each in velocities.tolist()])
    return np.asarray(velocities / np.where(sizes > 0.0, sizes, 1.0)[:, None])
