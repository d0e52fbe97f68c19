"""What the filter estimates: the order of its error state."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ffsm_mj.controller_protocol import System, Tree

SIZE = 12
"""Components of the error of a body."""


@dataclass(frozen=True)
class FloatingBody:
    """The root of a tree with a free joint.

    Its error (true less estimated) is the position in world axes in m, the rotation vector ``theta`` in body axes with
    ``R_true = R_estimated Exp(theta)``, the velocity of the body frame's origin in world axes in m/s, and the angular
    velocity in body axes in rad/s: coordinates and rates of MuJoCo's free joint.

    Attributes:
        tree: Its tree.
        first: Place of the first of the twelve components in the error state.
    """

    tree: Tree
    first: int

    @property
    def name(self) -> str:
        """Name of the tree: ``robot`` or that of the object."""
        return self.tree.name

    @property
    def joint(self) -> str:
        """Full name of the free joint."""
        return self.tree.joints[0].name

    @property
    def qpos(self) -> slice:
        """Position and quaternion in ``qpos``."""
        return self.tree.joints[0].qpos

    @property
    def dofs(self) -> slice:
        """Velocity and angular velocity in ``qvel``."""
        return self.tree.joints[0].dofs

    @property
    def turning(self) -> slice:
        """Angular velocity in ``qvel``."""
        return slice(self.dofs.start + 3, self.dofs.stop)

    @property
    def error(self) -> slice:
        """All components in the error state."""
        return slice(self.first, self.first + SIZE)

    @property
    def position(self) -> slice:
        """Error of the position."""
        return slice(self.first, self.first + 3)

    @property
    def attitude(self) -> slice:
        """Error of the attitude."""
        return slice(self.first + 3, self.first + 6)

    @property
    def velocity(self) -> slice:
        """Error of the velocity."""
        return slice(self.first + 6, self.first + 9)

    @property
    def rate(self) -> slice:
        """Error of the angular velocity."""
        return slice(self.first + 9, self.first + SIZE)


@dataclass(frozen=True)
class GyroBias:
    """The bias of a gyro, in the axes of its site.

    Attributes:
        sensor: Full name of the gyro.
        first: Place of the first of the three components in the error state.
        place: First of its components among all biases.
    """

    sensor: str
    first: int
    place: int

    @property
    def error(self) -> slice:
        """Its components in the error state."""
        return slice(self.first, self.first + 3)

    @property
    def value(self) -> slice:
        """Its components among all biases."""
        return slice(self.place, self.place + 3)


def floating_bodies(system: System) -> tuple[FloatingBody, ...]:
    """The floating bodies of a scene, in the order of its trees."""
    floating = [tree for tree in system.trees if tree.joints and tree.joints[0].kind == "free"]
    return tuple(FloatingBody(tree, SIZE * i) for i, tree in enumerate(floating))


class Layout:
    """Order of the error state.

    Attributes:
        bodies: The floating bodies.
        biases: The biases of gyros, behind the bodies.
        size: Components of the error state.
    """

    def __init__(self, bodies: Iterable[FloatingBody], gyros: Iterable[str]) -> None:
        """Biases behind bodies; ``gyros`` are full names of the gyros whose biases are estimated."""
        self.bodies = tuple(bodies)
        behind = SIZE * len(self.bodies)
        self.biases = tuple(GyroBias(name, behind + 3 * i, 3 * i) for i, name in enumerate(gyros))
        self.size = behind + 3 * len(self.biases)

    def bias_of(self, sensor: str) -> GyroBias | None:
        """Bias of a gyro, by its full name; None if it is not estimated."""
        return next((bias for bias in self.biases if bias.sensor == sensor), None)

    def named(self, name: str) -> FloatingBody:
        """Floating body by the name of its tree.

        Raises:
            KeyError: There is none.
        """
        return {body.name: body for body in self.bodies}[name]
