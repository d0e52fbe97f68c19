"""Drake: continuous plants with error control, and its discrete contact solvers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine_runs.scene import Scene, initial_twists
from engine_runs.states import States


@dataclass(frozen=True)
class Recipe:
    """``scheme``: an integrator of a continuous plant, or the contact approximation of a discrete one.

    ``step_s``: step of a discrete plant or of fixed steps, the largest step otherwise; ``accuracy``: of error control.
    """

    scheme: str
    step_s: float
    accuracy: float | None = None
    stiffness_N_m: float | None = None
    dissipation: float = 0.0
    stiction_m_s: float | None = None
    hydroelastic_Pa: float | None = None
    """Modulus of the shapes of the first of each pair; those of the second are rigid. None: point contact."""


HINT_M = 0.01
DISCRETE = {"sap": "kSap", "tamsi": "kTamsi", "similar": "kSimilar", "lagged": "kLagged"}


def _with_bodies(scene: Scene, plant: Any) -> None:
    from pydrake import all as drake

    for body in scene.bodies:
        rotational = drake.RotationalInertia(*body.inertia_kg_m2)
        inertia = drake.SpatialInertia.MakeFromCentralInertia(body.mass_kg, np.zeros(3), rotational)
        link = plant.AddRigidBody(body.name, inertia)
        joint = body.joint
        if joint is None:
            continue
        parent = plant.GetBodyByName(joint.parent) if joint.parent else plant.world_body()
        before = np.array(scene.body(joint.parent).position_m) if joint.parent else np.zeros(3)
        ends = []
        for where, of, origin in (("in", parent, before), ("out", link, np.array(body.position_m))):
            place = drake.RigidTransform(np.array(joint.anchor_m) - origin)
            ends.append(plant.AddFrame(drake.FixedOffsetFrame(f"{body.name}_{where}", of.body_frame(), place)))
        kind = drake.RevoluteJoint if joint.kind == "hinge" else drake.PrismaticJoint
        added = plant.AddJoint(kind(body.name, *ends, np.array(joint.axis), damping=joint.damping))
        if body.name in scene.efforts:
            plant.AddJointActuator(body.name, added)


def _with_shapes(scene: Scene, plant: Any, recipe: Recipe) -> None:
    from pydrake import all as drake

    for body in scene.bodies:
        if not any(body.name in pair for pair in scene.touching):
            continue
        shape = drake.Box(*(2 * np.array(body.half_m))) if body.half_m else drake.Sphere(body.radius_m)
        properties = drake.ProximityProperties()
        drake.AddContactMaterial(
            recipe.dissipation, recipe.stiffness_N_m, drake.CoulombFriction(scene.mu, scene.mu), properties
        )
        if recipe.hydroelastic_Pa is not None:
            if any(body.name == first for first, _ in scene.touching):
                drake.AddCompliantHydroelasticProperties(HINT_M, recipe.hydroelastic_Pa, properties)
            else:
                drake.AddRigidHydroelasticProperties(HINT_M, properties)
        plant.RegisterCollisionGeometry(plant.GetBodyByName(body.name), drake.RigidTransform(), shape, body.name, properties)


def built(scene: Scene, recipe: Recipe) -> tuple[Any, Any, Any]:
    """Simulator, plant and the plant's context at the start."""
    from pydrake import all as drake

    discrete = recipe.scheme in DISCRETE
    builder = drake.DiagramBuilder()
    plant, _ = drake.AddMultibodyPlantSceneGraph(builder, recipe.step_s if discrete else 0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    _with_bodies(scene, plant)
    if scene.touching:
        _with_shapes(scene, plant, recipe)
    if discrete:
        plant.set_discrete_contact_approximation(getattr(drake.DiscreteContactApproximation, DISCRETE[recipe.scheme]))
    if scene.weld:
        first, second = (scene.body(name) for name in scene.weld)
        place = np.array(second.position_m) - np.array(first.position_m)
        plant.AddWeldConstraint(
            plant.GetBodyByName(first.name),
            drake.RigidTransform(place),
            plant.GetBodyByName(second.name),
            drake.RigidTransform(),
        )
    if recipe.hydroelastic_Pa is not None:
        plant.set_contact_model(drake.ContactModel.kHydroelastic)
    plant.Finalize()
    if recipe.stiction_m_s is not None:
        plant.set_stiction_tolerance(recipe.stiction_m_s)
    simulator = drake.Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    twists = initial_twists(scene)
    for body in scene.bodies:
        link = plant.GetBodyByName(body.name)
        if body.joint is None:
            plant.SetFreeBodyPose(context, link, drake.RigidTransform(np.array(body.position_m)))
            v, w = twists[body.name]
            plant.SetFreeBodySpatialVelocity(context, link, drake.SpatialVelocity(w, v))
        elif body.joint.rate:
            plant.GetJointByName(body.name).set_angular_rate(context, body.joint.rate)
    if not discrete:
        config = drake.SimulatorConfig(
            integration_scheme=recipe.scheme,
            max_step_size=recipe.step_s,
            accuracy=recipe.accuracy or 1e-3,
            use_error_control=recipe.accuracy is not None,
        )
        drake.ApplySimulatorConfig(config, simulator)
    return simulator, plant, context


def states(scene: Scene, plant: Any, context: Any) -> States:
    """Of every body."""
    rows: list[list[np.ndarray]] = [[], [], [], []]
    for body in scene.bodies:
        link = plant.GetBodyByName(body.name)
        pose, twist = plant.EvalBodyPoseInWorld(context, link), plant.EvalBodySpatialVelocityInWorld(context, link)
        rows[0].append(pose.translation())
        rows[1].append(pose.rotation().ToQuaternion().wxyz())
        rows[2].append(twist.translational())
        rows[3].append(twist.rotational())
    return States(*(np.array(row) for row in rows))


def run(scene: Scene, recipe: Recipe) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of ``AdvanceTo``."""
    simulator, plant, context = built(scene, recipe)

    def push(time_s: float) -> None:
        if plant.num_actuators():
            efforts = [effort if time_s >= begin else 0.0 for effort, begin in scene.efforts.values()]
            plant.get_actuation_input_port().FixValue(context, np.array(efforts))

    push(0.0)
    simulator.Initialize()
    found, spent = [], 0.0
    for time_s in sorted({*scene.times_s, *(begin for _, begin in scene.efforts.values() if begin > 0.0)}):
        clock = time.process_time()
        simulator.AdvanceTo(time_s)
        spent += time.process_time() - clock
        if time_s in scene.times_s:
            found.append(states(scene, plant, context))
        push(time_s)
    return found, spent
