"""Four scenes in zero gravity, described once and built by the adapter of each engine.

At the start every body frame has the orientation of the world and its origin at the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Joint:
    """A joint to ``parent`` ("" is the world); ``anchor_m`` in the world at the start."""

    parent: str
    kind: str
    axis: Vector
    anchor_m: Vector
    rate: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Body:
    """A rigid body; ``joint`` None: free. ``half_m``: box; ``radius_m``: sphere; neither: no geometry."""

    name: str
    mass_kg: float
    inertia_kg_m2: Vector
    position_m: Vector
    joint: Joint | None = None
    velocity_m_s: Vector = ZERO
    rate_rad_s: Vector = ZERO
    half_m: Vector | None = None
    radius_m: float = 0.0


@dataclass(frozen=True)
class Scene:
    """Bodies in order of the tree, what acts on them, and the times at which states are taken."""

    name: str
    bodies: tuple[Body, ...]
    times_s: tuple[float, ...]
    touching: tuple[tuple[str, str], ...] = ()
    weld: tuple[str, str] | None = None
    restitution: float = 0.0
    mu: float = 0.0
    efforts: dict[str, tuple[float, float]] = field(default_factory=dict)
    """By name of the body that a joint moves: effort in N or N m, and the time in s at which it begins."""

    def body(self, name: str) -> Body:
        """By name."""
        return next(body for body in self.bodies if body.name == name)

    @property
    def duration_s(self) -> float:
        """Of a run."""
        return self.times_s[-1]


def _box_inertia(mass_kg: float, half_m: Vector) -> Vector:
    x, y, z = (half * half for half in half_m)
    return (mass_kg / 3 * (y + z), mass_kg / 3 * (x + z), mass_kg / 3 * (x + y))


HIT_S, OFFSET_M, BALL_M = 0.4837, 0.3, 0.1
BAR_HALF_M = (0.1, 0.5, 0.1)


def collision(restitution: float) -> Scene:
    """A ball of 1 kg at 1 m/s hits a box of 2 kg at rest 0.3 m beside its centre, inside a step above 0.1 ms."""
    ball = Body(
        "ball",
        1.0,
        (0.004, 0.004, 0.004),
        (-BAR_HALF_M[0] - BALL_M - HIT_S, OFFSET_M, 0.0),
        velocity_m_s=(1.0, 0.0, 0.0),
        radius_m=BALL_M,
    )
    box = Body("box", 2.0, _box_inertia(2.0, BAR_HALF_M), ZERO, half_m=BAR_HALF_M)
    return Scene("collision", (ball, box), (1.0,), touching=(("ball", "box"),), restitution=restitution)


MU, GRIP_N, SETTLE_S, LOAD_S = 0.7, 10.0, 0.5, 2.0
BASE_KG, FINGER_KG, HELD_KG = 10.0, 0.2, 2.0
PUSHED_KG = BASE_KG + 2 * FINGER_KG + HELD_KG
PUSH_N = 0.5 * 2 * MU * GRIP_N * PUSHED_KG / HELD_KG
FINGER_DAMPING = 50.0


def grip() -> Scene:
    """A box of 2 kg between two fingers of 10 N each; the base is pushed so that the box needs half of 2 mu N."""
    half, pad = (0.05, 0.05, 0.05), (0.02, 0.01, 0.02)
    base = Body("base", BASE_KG, (1.0, 1.0, 1.0), ZERO, joint=Joint("", "slide", (1.0, 0.0, 0.0), ZERO))
    fingers = (
        Body(
            name,
            FINGER_KG,
            (0.001, 0.001, 0.001),
            (0.0, side * 0.06, 0.0),
            joint=Joint("base", "slide", (0.0, 1.0, 0.0), (0.0, side * 0.06, 0.0), damping=FINGER_DAMPING),
            half_m=pad,
        )
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    box = Body("box", HELD_KG, (0.004, 0.004, 0.004), ZERO, half_m=half)
    end = SETTLE_S + LOAD_S
    return Scene(
        "grip",
        (base, *fingers, box),
        (SETTLE_S, end - 1.0, end),
        touching=(("left", "box"), ("right", "box")),
        mu=MU,
        efforts={"base": (PUSH_N, SETTLE_S), "left": (-GRIP_N, 0.0), "right": (GRIP_N, 0.0)},
    )


def free_flight() -> Scene:
    """A free base with three links on hinges tumbles for 10 s."""
    base = Body("base", 5.0, (0.3, 0.4, 0.5), ZERO, velocity_m_s=(0.1, -0.05, 0.02), rate_rad_s=(0.2, -0.3, 0.4))
    links, parent = [], "base"
    for i, (axis, rate) in enumerate((((0.0, 0.0, 1.0), 0.5), ((0.0, 1.0, 0.0), -0.4), ((0.0, 0.0, 1.0), 0.6))):
        start = 0.3 + 0.5 * i
        joint = Joint(parent, "hinge", axis, (start, 0.0, 0.0), rate)
        parent = f"link_{i}"
        links.append(Body(parent, 1.0, (0.002, 0.021, 0.021), (start + 0.25, 0.0, 0.0), joint=joint))
    return Scene("flight", (base, *links), (10.0,))


LOAD_WINDOW_S = 0.1


def weld() -> Scene:
    """An object of 2 kg attached to a base of 10 kg while both tumble as one body for 10 s."""
    rate, velocity, place = np.array([0.5, 0.8, -0.6]), np.array([0.05, -0.02, 0.03]), np.array([0.4, 0.1, 0.05])
    base = Body("base", 10.0, (0.4, 0.5, 0.6), ZERO, velocity_m_s=tuple(velocity), rate_rad_s=tuple(rate))
    held = replace(
        base,
        name="object",
        mass_kg=2.0,
        inertia_kg_m2=(0.02, 0.03, 0.04),
        position_m=tuple(place),
        velocity_m_s=tuple(velocity + np.cross(rate, place)),
    )
    return Scene("weld", (base, held), (10.0 - LOAD_WINDOW_S, 10.0), weld=("base", "object"))


def initial_twists(scene: Scene) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Velocity of the centre of mass and angular velocity of every body at the start, in the world."""
    twists: dict[str, tuple[np.ndarray, np.ndarray]] = {"": (np.zeros(3), np.zeros(3))}
    places = {"": np.zeros(3)} | {body.name: np.array(body.position_m) for body in scene.bodies}
    for body in scene.bodies:
        if body.joint is None:
            twists[body.name] = np.array(body.velocity_m_s), np.array(body.rate_rad_s)
            continue
        v, w = twists[body.joint.parent]
        along = body.joint.rate * np.array(body.joint.axis)
        anchor = np.array(body.joint.anchor_m)
        v_anchor = v + np.cross(w, anchor - places[body.joint.parent])
        if body.joint.kind == "hinge":
            w = w + along
            v = v_anchor + np.cross(w, places[body.name] - anchor)
        else:
            v = v_anchor + along + np.cross(w, places[body.name] - anchor)
        twists[body.name] = v, w
    return {body.name: twists[body.name] for body in scene.bodies}
