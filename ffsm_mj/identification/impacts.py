"""Measured single impacts: velocities before and after, contact rows, errors in the energy norm, and what no law can beat.

An impact of a rigid system through one contact point changes the velocity by M^-1 (n^T p_n + d^T p_t). How far a measured
velocity is from all of these is the least error that any impact law can have on it (:func:`least_errors`), in the cone of
friction or not. Whether the momenta that were measured obey the contact rows is :func:`moment_balance`: a frame whose
handedness is reversed between linear and angular velocities, or between velocities and rows, fails there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ffsm_mj.arrays import BoolArray, FloatArray, IntArray

_CONE_STEPS = 2000
"""Most steps of the projection onto the friction cone; it ends long before for every contact that can move."""
_CONE_END = 1e-14
"""Relative change of the impulse at which the projection ends: two orders above rounding."""
NO_FRICTION = 0.05
"""Ratio of tangential to normal impulse below which its direction is noise: a tenth or so of usual coefficients."""


@dataclass(frozen=True)
class MeasuredImpacts:
    """Single impacts of a system with n velocity coordinates through one contact point, k of them.

    Attributes:
        M: Mass matrices, (k, n, n), or one for all, (n, n).
        normal: Contact row n of each: n @ v is the normal velocity, negative before the impact, (k, n).
        tangents: Rows d across it: one in the plane, (k, 1, n), two in space, (k, 2, n), orthogonal and of unit length.
        before: Velocities before, (k, n).
        after: Velocities after, (k, n).
        angular: Velocity coordinates that are angular velocities; the others are linear.
        compliance_ratio: Tangential over normal compliance of the surfaces, for laws that use it; 0: rigid.
    """

    M: FloatArray
    normal: FloatArray
    tangents: FloatArray
    before: FloatArray
    after: FloatArray
    angular: tuple[int, ...]
    compliance_ratio: float = 0.0

    def __len__(self) -> int:
        return len(self.before)

    def select(self, which: IntArray | BoolArray) -> MeasuredImpacts:
        """Some of the impacts, in the order of ``which``."""
        return replace(
            self,
            M=self.M[which] if self.M.ndim == 3 else self.M,
            **{name: getattr(self, name)[which] for name in ("normal", "tangents", "before", "after")},
        )

    def with_reversed_tangents(self) -> MeasuredImpacts:
        """The impacts with the other sign of the angular columns of the tangents: the mirror that n @ v does not show."""
        tangents = self.tangents.copy()
        tangents[:, :, self.angular] *= -1.0
        return replace(self, tangents=tangents)

    def with_reversed_rotation(self) -> MeasuredImpacts:
        """The impacts with the other sense of rotation: angular velocities in a frame of the other handedness."""
        before, after = self.before.copy(), self.after.copy()
        before[:, self.angular] *= -1.0
        after[:, self.angular] *= -1.0
        return replace(self, before=before, after=after)

    @property
    def linear(self) -> tuple[int, ...]:
        """Velocity coordinates that are linear velocities."""
        return tuple(i for i in range(self.before.shape[1]) if i not in self.angular)

    @cached_property
    def rows(self) -> FloatArray:
        """Rows of normal and tangents, (k, 1 + t, n)."""
        return np.concatenate([self.normal[:, None], self.tangents], axis=1)

    @cached_property
    def L(self) -> FloatArray:
        """Lower Cholesky factors of M, (k, n, n)."""
        return np.broadcast_to(np.linalg.cholesky(self.M), (len(self), *self.M.shape[-2:]))

    @cached_property
    def A(self) -> FloatArray:
        """Rows in mass-weighted coordinates, J L^-T, (k, 1 + t, n)."""
        return np.asarray(np.linalg.solve(self.L, self.rows.transpose(0, 2, 1)).transpose(0, 2, 1))

    def weighted(self, velocities: FloatArray) -> FloatArray:
        """Mass-weighted velocities L^T v, whose squares are twice the kinetic energies, (k, n)."""
        return np.asarray(np.einsum("kji,kj->ki", self.L, velocities))

    @cached_property
    def speeds(self) -> FloatArray:
        """Sizes |L^T v| of the velocities before, the unit of errors, (k,)."""
        return np.asarray(np.linalg.norm(self.weighted(self.before), axis=1))

    def errors(self, velocities: FloatArray) -> FloatArray:
        """Errors E of predicted velocities: |v - v_after| / |v_before| in the norm of the kinetic energy, (k,)."""
        return np.asarray(np.linalg.norm(self.weighted(velocities - self.after), axis=1) / self.speeds)

    def energy_ratios(self, velocities: FloatArray) -> FloatArray:
        """Kinetic energies of velocities over those before, (k,)."""
        return np.asarray((np.linalg.norm(self.weighted(velocities), axis=1) / self.speeds) ** 2)

    def velocities_after(self, impulses: FloatArray) -> FloatArray:
        """Velocities after impulses (p_n, p_t), (k, 1 + t), along the rows, (k, n)."""
        change = np.einsum("kij,ki->kj", self.A, impulses)  # of L^T v
        return self.before + np.linalg.solve(self.L.transpose(0, 2, 1), change[..., None])[..., 0]

    @cached_property
    def momenta(self) -> FloatArray:
        """Changes of momentum M (v_after - v_before), (k, n)."""
        return np.asarray(np.einsum("...ij,...j->...i", self.M, self.after - self.before))


@dataclass(frozen=True)
class LeastErrors:
    """The least error of each impact that an impulse through the contact point can have.

    Attributes:
        errors: In the energy norm, (k,).
        impulses: The impulses (p_n, p_t) that have it, N s, (k, 1 + t).
    """

    errors: FloatArray
    impulses: FloatArray


def least_errors(impacts: MeasuredImpacts, mu: float | None = None) -> LeastErrors:
    """Least error that any rigid impact through the contact point can have; no law with these rows is better.

    Args:
        impacts: The impacts.
        mu: Also within the cone of this coefficient of friction; None: any impulse, a pulling one too.
    """
    change = impacts.weighted(impacts.after - impacts.before)
    # Least squares in mass-weighted coordinates, where the error is the Euclidean distance of w_after from w + A^T p.
    impulses = np.einsum("kij,kj->ki", np.linalg.pinv(impacts.A.transpose(0, 2, 1)), change)
    if mu is not None:
        impulses = _nearest_in_cone(impacts.A, impulses, mu)
    return LeastErrors(impacts.errors(impacts.velocities_after(impulses)), impulses)


def _nearest_in_cone(A: FloatArray, free: FloatArray, mu: float) -> FloatArray:
    """Impulses in the friction cone nearest to others in the metric A A^T, (k, 1 + t): accelerated projected gradients.

    In the plane this has a closed form; in space the nearest point of the cone is a root of degree six, and the iteration is
    the same for both. Its rate is that of Nesterov's method for a strongly convex function.
    """
    G = np.einsum("kij,klj->kil", A, A)
    sizes = np.linalg.eigvalsh(G)
    step = 1.0 / sizes[:, -1:]
    root = np.sqrt(np.maximum(sizes[:, :1], 0.0) * step)
    momentum = (1.0 - root) / (1.0 + root)
    impulses = ahead = _onto_cone(free, mu)
    for _ in range(_CONE_STEPS):
        following = _onto_cone(ahead - step * np.einsum("kij,kj->ki", G, ahead - free), mu)
        change = np.abs(following - impulses).max()
        ahead, impulses = following + momentum * (following - impulses), following
        if change <= _CONE_END * np.abs(free).max():
            break
    return np.asarray(impulses)


def _onto_cone(impulses: FloatArray, mu: float) -> FloatArray:
    """Nearest points of the cone |p_t| <= mu p_n in the Euclidean metric, (k, 1 + t)."""
    normal, across = impulses[:, :1], impulses[:, 1:]
    size = np.linalg.norm(across, axis=1, keepdims=True)
    along = np.maximum((normal + mu * size) / (1.0 + mu * mu), 0.0)  # on the nearest generator; the apex if behind it
    side = np.divide(across, size, out=np.zeros_like(across), where=size > 0.0)
    nearest = np.concatenate([along, mu * along * side], axis=1)
    return np.where(size <= mu * normal, impulses, nearest)


@dataclass(frozen=True)
class MomentBalance:
    """How the measured momenta obey the contact rows: the impulse is that of the linear momenta.

    Attributes:
        r_squared: R^2 of the changes of angular momentum about the mass centre, as the moments of that impulse at the
            contact point: 1 if they agree, below 0 if no change at all would be a better prediction.
        misses: Distance at which the line of the impulse misses the contact point, m, (k,): the moment that is left, per
            impulse.
        along_slip: Of the impacts with friction, the share whose friction acts along the mean slip, not against it.
        slip_grows: Share of the impacts whose slip is faster after than before.
    """

    r_squared: float
    misses: FloatArray
    along_slip: float
    slip_grows: float


def moment_balance(impacts: MeasuredImpacts) -> MomentBalance:
    """Compare the changes of linear and of angular momentum of free bodies, whose coordinates are about the mass centre."""
    linear, angular = list(impacts.linear), list(impacts.angular)
    P = impacts.momenta[:, linear]
    # Impulses along the rows that give the change of linear momentum: rows of one body are orthonormal there.
    impulses = np.einsum("kij,kj->ki", np.linalg.pinv(impacts.rows[:, :, linear].transpose(0, 2, 1)), P)
    moments = impacts.momenta[:, angular]
    missing = moments - np.einsum("kij,ki->kj", impacts.rows[:, :, angular], impulses)
    slips = [np.einsum("kij,kj->ki", impacts.tangents, v) for v in (impacts.before, impacts.after)]
    sizes = [np.linalg.norm(slip, axis=1) for slip in slips]
    rubs = np.linalg.norm(impulses[:, 1:], axis=1) > NO_FRICTION * np.abs(impulses[:, 0])
    works = np.einsum("ki,ki->k", impulses[:, 1:], slips[0] + slips[1])
    return MomentBalance(
        r_squared=1.0 - float(np.sum(missing**2) / np.sum((moments - moments.mean(axis=0)) ** 2)),
        misses=np.asarray(np.linalg.norm(missing, axis=1) / np.linalg.norm(P, axis=1)),
        along_slip=float(np.mean(works[rubs] > 0.0)) if rubs.any() else 0.0,
        slip_grows=float(np.mean(sizes[1] > sizes[0])),
    )


AS_RECORDED = "as recorded"
_FRAMES: dict[str, Callable[[MeasuredImpacts], MeasuredImpacts]] = {
    AS_RECORDED: lambda impacts: impacts,
    "tangents reversed": MeasuredImpacts.with_reversed_tangents,
    "rotation reversed": MeasuredImpacts.with_reversed_rotation,
}


def frame_of(impacts: MeasuredImpacts, name: str) -> MeasuredImpacts:
    """The impacts in a frame of :func:`frame_test`."""
    return _FRAMES[name](impacts)


def frame_test(impacts: MeasuredImpacts) -> dict[str, MomentBalance]:
    """Moment balances of impacts as recorded, and in frames of the other handedness; the highest R^2 is the consistent one.

    ``tangents reversed``: the angular columns of the tangents have the other sign, which no normal velocity shows.
    ``rotation reversed``: the angular velocities have it, as those of a left-handed frame.
    """
    return {name: moment_balance(frame_of(impacts, name)) for name in _FRAMES}
