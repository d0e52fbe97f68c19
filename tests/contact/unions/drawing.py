"""Random bodies that slide, spin, drop and roll on a box, whole or cut at random, and the same with other pieces."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.contact.unions.scenes import Box, fixed, free, geoms, on
from tests.random_scenes.dice import Dice, numbers

KINDS = ("sphere", "box", "capsule", "cylinder")
MOTIONS = ("slide", "spin", "drop", "roll")
MOST_PIECES = 6
LONG: Box = ((-1.0, -0.8, -0.1), (1.0, 0.8, 0.0))
"""A box that a body does not leave within its run."""


@dataclass(frozen=True)
class Drawn:
    """A body over a box, and the pieces of that box.

    Attributes:
        seed: The seed.
        kind: Kind of its geom.
        motion: What it does.
        body: Its model.
        whole: The box.
        pieces: The same cut, one to six.
        keys: Further arguments of the scene: state, restitution, friction and duration.
    """

    seed: int
    kind: str
    motion: str
    body: str
    whole: Box
    pieces: list[Box]
    keys: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What it is, in a line."""
        keys = ", ".join(f"{name} {self.keys[name]:g}" for name in ("restitution", "mu", "duration_s"))
        return f"seed {self.seed}: {self.motion} of a {self.kind} over {len(self.pieces)} pieces, {keys}"

    def on_whole(self, folder: Path) -> Path:
        """The scenario with the box as one piece."""
        return on(folder, self.body, fixed(geoms([self.whole])), **self.keys)

    def on_pieces(self, folder: Path) -> Path:
        """The scenario with its pieces."""
        return on(folder, self.body, fixed(geoms(self.pieces)), **self.keys)

    def on_other_pieces(self, folder: Path) -> Path:
        """The scenario with one more cut and the pieces in another order."""
        dice = Dice(self.seed, "other pieces")
        pieces = cut(dice, self.pieces, len(self.pieces) + 1)
        return on(folder, self.body, fixed(geoms([pieces[i] for i in dice.rng.permutation(len(pieces))])), **self.keys)


def cut(dice: Dice, pieces: list[Box], number: int) -> list[Box]:
    """Cut pieces one by one along x or y, most of them where the body passes, until there are so many."""
    pieces = list(pieces)
    while len(pieces) < number:
        spans = [piece for piece in pieces if piece[0][0] < 0.4 and piece[1][0] > -0.4] or pieces
        lower, upper = spans[dice.integer(0, len(spans) - 1)]
        axis, share = dice.integer(0, 1), dice.between(0.15, 0.85)
        # Corners are shared bit for bit here; sizes and places in the file round them by themselves.
        at = lower[axis] + share * (upper[axis] - lower[axis])
        if (near := max(lower[axis], -0.4)) < (far := min(upper[axis], 0.4)) and dice.chance(0.7):
            at = near + share * (far - near)
        pieces.remove((lower, upper))
        pieces += [(lower, _with(upper, axis, at)), (_with(lower, axis, at), upper)]
    return pieces


def _with(corner: tuple[float, float, float], axis: int, at: float) -> tuple[float, float, float]:
    moved = list(corner)
    moved[axis] = at
    return tuple(moved)


def draw(seed: int) -> Drawn:
    """The scene of a seed; kinds and motions take turns, so that any few seeds in a row have several of them."""
    kind, motion = KINDS[seed % 4], MOTIONS[seed // 4 % 4]
    dice = Dice(seed, f"{motion} of a {kind}")
    size, half = dice.between(0.06, 0.12), dice.between(0.06, 0.12)
    sizes = {"sphere": [size], "box": [size, half, dice.between(0.06, 0.12)]}.get(kind, [size, half])
    mass = dice.between(1.0, 3.0)
    inertia = mass * 0.004 * np.array([dice.between(0.9, 1.1) for _ in range(3)])
    if kind in ("capsule", "cylinder"):
        inertia[1] = inertia[0]
    if kind == "sphere":
        inertia[:] = inertia[0]
    body = free(f'<geom name="g" type="{kind}" size="{numbers(sizes)}" mass="0"/>', mass=mass, inertia=inertia)
    joints, rates = _state(dice, kind, motion, sizes)
    keys = {
        "joints": joints,
        "rates": rates,
        "restitution": dice.pick((0.0, 0.5, 1.0)),
        "mu": dice.pick((0.0, 0.0, dice.between(0.05, 0.3), dice.between(0.3, 0.8))),
        "duration_s": 0.25 if motion == "drop" else 0.4,
    }
    return Drawn(seed, kind, motion, body, LONG, cut(dice, [LONG], dice.integer(1, MOST_PIECES)), keys)


def _state(dice: Dice, kind: str, motion: str, sizes: list[float]) -> tuple[list[float], list[float]]:
    """Pose and rates: at rest on z = 0 or above it, moving over the middle of the box."""
    yaw, direction, speed = (dice.between(-math.pi, math.pi) for _ in range(2)), 0.0, dice.between(0.3, 1.2)
    yaw, direction = yaw
    # Capsules lie; so do cylinders that roll, others stand on their caps.
    lies = kind == "capsule" or (kind == "cylinder" and motion == "roll")
    height = {"sphere": sizes[0], "box": sizes[-1], "capsule": sizes[0], "cylinder": sizes[0 if lies else -1]}[kind]
    quaternion = _product(_about("z", yaw), _about("y", math.pi / 2.0) if lies else [1.0, 0.0, 0.0, 0.0])
    if motion == "roll":
        # Bodies with a horizontal axis of symmetry roll across it; what is missing of the rate of pure rolling, slips.
        direction = yaw + math.pi / 2.0
    velocity = speed * np.array([math.cos(direction), math.sin(direction), 0.0])
    start = [*(-0.5 * 0.4 * velocity[:2] + [dice.between(-0.05, 0.05), dice.between(-0.05, 0.05)]), height]
    spin = np.zeros(3)
    if motion == "spin":
        spin[2] = dice.between(-6.0, 6.0)
    elif motion == "roll":
        share = dice.pick((1.0, 0.0, dice.between(0.0, 1.5)))
        spin = share * np.cross([0.0, 0.0, 1.0], velocity) / height if kind != "box" else spin
        spin[2] += dice.pick((0.0, dice.between(-1.0, 1.0))) if kind == "sphere" else 0.0
        if kind == "box":  # a box that rolls rocks: it stands tilted on an edge
            quaternion, start[2] = _tilted(quaternion, dice.between(0.02, 0.3), sizes)
    elif motion == "drop":
        start[2] += dice.between(0.005, 0.05)
        spin = np.array(dice.vector(dice.pick((0.0, 1.0, 3.0))))
        velocity[2] = -dice.between(0.0, 0.5)
        if dice.chance(0.6):
            quaternion = dice.turn()
            start[2] = 0.01 + (float(np.linalg.norm(sizes)) if kind in ("box", "cylinder") else sum(sizes))
    rotation = np.array(_matrix(quaternion))
    return [*start, *quaternion], [*velocity, *(rotation.T @ spin)]


def _tilted(quaternion: list[float], angle: float, sizes: list[float]) -> tuple[list[float], float]:
    """A box turned about its y axis so far that it stands on one edge, and the height of its centre."""
    height = sizes[2] * math.cos(angle) + sizes[0] * math.sin(angle)
    return _product(quaternion, _about("y", angle)), height


def _about(axis: str, angle: float) -> list[float]:
    parts = [0.0, 0.0, 0.0]
    parts["xyz".index(axis)] = math.sin(angle / 2.0)
    return [math.cos(angle / 2.0), *parts]


def _product(first: list[float], second: list[float]) -> list[float]:
    a, u, b, v = first[0], np.array(first[1:]), second[0], np.array(second[1:])
    return [float(a * b - u @ v), *(a * v + b * u + np.cross(u, v)).tolist()]


def _matrix(quaternion: list[float]) -> list[list[float]]:
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
