"""Newton on the CPU, one world, single precision: its solvers Kamino (PADMM, LOX), XPBD and Featherstone."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from engine_runs.scene import Body, Scene, initial_twists
from engine_runs.states import States

WARM_UP_STEPS = 3
MOST_CONTACTS = 16


@dataclass(frozen=True)
class Recipe:
    """Solver and its options; ``gap_m``: distance from which contacts are predicted."""

    solver: str
    gap_m: float = 0.01
    options: dict[str, Any] = field(default_factory=dict)


def _add_joint(builder: Any, scene: Scene, body: Body, numbers: dict[str, int]) -> int:
    import warp as wp

    joint = body.joint
    if joint is None:
        if scene.weld and body.name == scene.weld[1]:
            place = np.array(body.position_m) - np.array(scene.body(scene.weld[0]).position_m)
            ends = wp.transform(wp.vec3(*place), wp.quat_identity())
            return int(builder.add_joint_fixed(numbers[scene.weld[0]], numbers[body.name], parent_xform=ends))
        return int(builder.add_joint_free(numbers[body.name]))
    before = np.array(scene.body(joint.parent).position_m) if joint.parent else np.zeros(3)
    frames = {
        key: wp.transform(wp.vec3(*(np.array(joint.anchor_m) - origin)), wp.quat_identity())
        for key, origin in (("parent_xform", before), ("child_xform", np.array(body.position_m)))
    }
    add = builder.add_joint_revolute if joint.kind == "hinge" else builder.add_joint_prismatic
    parent = numbers[joint.parent] if joint.parent else -1
    return int(
        add(
            parent,
            numbers[body.name],
            axis=wp.vec3(*joint.axis),
            limit_ke=0.0,
            limit_kd=0.0,
            armature=0.0,
            **({"target_kd": joint.damping, "actuator_mode": _effort_mode()} if joint.damping else {}),
            **frames,
        )
    )


def _effort_mode() -> Any:
    """Drive towards zero speed: the damping of the fingers."""
    import newton

    return newton.JointTargetMode.VELOCITY


def _add_body(builder: Any, scene: Scene, body: Body, shape: Any) -> int:
    import warp as wp

    number = int(
        builder.add_link(
            xform=wp.transform(wp.vec3(*body.position_m), wp.quat_identity()),
            mass=body.mass_kg,
            inertia=wp.mat33(*np.diag(body.inertia_kg_m2).ravel()),
            lock_inertia=True,
        )
    )
    if not any(body.name in pair for pair in scene.touching):
        return number
    if body.half_m:
        x, y, z = body.half_m
        builder.add_shape_box(number, hx=x, hy=y, hz=z, cfg=shape)
    else:
        builder.add_shape_sphere(number, radius=body.radius_m, cfg=shape)
    return number


def built(scene: Scene, recipe: Recipe) -> tuple[Any, Any, dict[str, int], list[int]]:
    """Model, solver, bodies by name and joints in the order of the bodies."""
    import newton
    import warp as wp

    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    builder.rigid_gap = recipe.gap_m
    newton.solvers.SolverKamino.register_custom_attributes(builder)
    shape = newton.ModelBuilder.ShapeConfig(
        density=0.0, mu=scene.mu, restitution=scene.restitution, mu_torsional=0.0, mu_rolling=0.0, gap=recipe.gap_m
    )
    numbers = {body.name: _add_body(builder, scene, body, shape) for body in scene.bodies}
    trees: dict[str, list[int]] = {}
    root: dict[str, str] = {}
    joints = []
    for body in scene.bodies:
        above = body.joint.parent if body.joint else (scene.weld[0] if scene.weld and body.name == scene.weld[1] else "")
        root[body.name] = root[above] if above else body.name
        joints.append(_add_joint(builder, scene, body, numbers))
        trees.setdefault(root[body.name], []).append(joints[-1])
    for tree in trees.values():
        builder.add_articulation(tree)
    for body, (v, w) in zip(scene.bodies, initial_twists(scene).values(), strict=True):
        builder.body_qd[numbers[body.name]] = wp.spatial_vector(*v, *w)
    model = builder.finalize(device="cpu")
    model.rigid_contact_max = MOST_CONTACTS  # Kamino's dense problem has this size
    return model, _solver(model, recipe), numbers, joints


def _solver(model: Any, recipe: Recipe) -> Any:
    from newton import solvers

    if recipe.solver == "xpbd":
        return solvers.SolverXPBD(model, **recipe.options)
    if recipe.solver == "featherstone":
        return solvers.SolverFeatherstone(model, angular_damping=0.0, **recipe.options)
    config = solvers.SolverKamino.Config(dynamics_solver=recipe.solver)
    for path, value in recipe.options.items():
        part, _, name = path.rpartition(".")
        setattr(getattr(config, part) if part else config, name, value)
    return solvers.SolverKamino(model, config=config)


def states(scene: Scene, state: Any, numbers: dict[str, int]) -> States:
    """Of every body."""
    rows = [numbers[body.name] for body in scene.bodies]
    q, qd = state.body_q.numpy()[rows].astype(float), state.body_qd.numpy()[rows].astype(float)
    return States(q[:, :3], q[:, [6, 3, 4, 5]], qd[:, :3], qd[:, 3:])


def run(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of collision detection and steps, kernels compiled before."""
    import newton
    import warp as wp

    wp.config.quiet = True
    model, solver, numbers, joints = built(scene, recipe)
    pipeline = newton.CollisionPipeline(model) if scene.touching else None
    contacts = pipeline.contacts() if pipeline else None
    control, names = model.control(), [body.name for body in scene.bodies]
    first_dof = model.joint_qd_start.numpy()

    def started() -> list[Any]:
        pair = [model.state(), model.state()]
        newton.eval_ik(model, pair[0], pair[0].joint_q, pair[0].joint_qd)
        return pair

    def advance(pair: list[Any], steps: int) -> None:
        for _ in range(steps):
            if pipeline:
                pipeline.collide(pair[0], contacts)
            solver.step(pair[0], pair[1], control, contacts, step_s)
            pair.reverse()

    def push(time_s: float) -> None:
        efforts = control.joint_f.numpy()
        for name, (effort, begin) in scene.efforts.items():
            efforts[first_dof[joints[names.index(name)]]] = effort if time_s >= begin - 1e-12 else 0.0
        control.joint_f.assign(efforts)

    push(0.0)
    advance(started(), WARM_UP_STEPS)
    solver = _solver(model, recipe)  # without what the warm-up left in it
    pair, found, spent, done = started(), [], 0.0, 0
    for time_s in sorted({*scene.times_s, *(begin for _, begin in scene.efforts.values() if begin > 0.0)}):
        steps = round(time_s / step_s) - done
        clock = time.process_time()
        advance(pair, steps)
        spent += time.process_time() - clock
        done += steps
        if time_s in scene.times_s:
            found.append(states(scene, pair[0], numbers))
        push(time_s)
    return found, spent
