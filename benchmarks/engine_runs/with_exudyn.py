"""Exudyn: joints as constraints, or a tree in minimal coordinates; implicit or explicit steps; spheres touch by penalty."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine_runs.mjcf import frame_of
from engine_runs.scene import Body, Scene, initial_twists
from engine_runs.states import States


@dataclass(frozen=True)
class Recipe:
    """``solver``: a ``DynamicSolverType``; ``node``: a ``NodeType``, explicit steps need that of the Lie group.

    ``stiffness_N_m``: of contacts; ``zone_m_s``: speed below which friction is proportional to it; ``accuracy``: of
    error control.
    """

    solver: str = "TrapezoidalIndex2"
    node: str = "RotationEulerParameters"
    stiffness_N_m: float = 1e6
    zone_m_s: float = 1e-3
    accuracy: float = 1e-8


RIM_M = 0.01
"""Radius of the spheres at the corners of a pad: Exudyn has contact of spheres with triangles, not of boxes."""
LINEAR, MIXED = 0, 2
"""``impactModel``: with a damper, or with a restitution; of the two with one, 2 has the accurate restitution."""
PAD_DAMPING = 400.0
"""N s/m at each of four spheres of 0.05 kg on 1e6 N/m: near the critical 2 sqrt(k m)."""


def _faces(half: np.ndarray) -> list[list[list[float]]]:
    """Corners of the six faces of a box, normals outwards."""
    faces = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            corners = []
            for a, b in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
                corner = np.empty(3)
                corner[[axis, (axis + 1) % 3, (axis + 2) % 3]] = sign, a, sign * b
                corners.append((corner * half).tolist())
            faces.append(corners)
    return faces


def _spheres(body: Body) -> list[tuple[list[float], float]]:
    """The sphere of a body, or small ones at the corners of its box, whose faces they touch from inside."""
    if body.half_m is None:
        return [([0.0, 0.0, 0.0], body.radius_m)]
    inner = np.array(body.half_m) - RIM_M
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    return [(place.tolist(), RIM_M) for place in np.unique(signs * inner, axis=0)]


def _touch(mbs: Any, scene: Scene, numbers: dict[str, Any], recipe: Recipe) -> None:
    """The faces of the second body of each pair that the spheres of the first can reach."""
    for first, second in scene.touching:
        sphere, box = scene.body(first), scene.body(second)
        towards = np.array(sphere.position_m) - np.array(box.position_m)
        axis = int(np.argmax(np.abs(towards) / np.array(box.half_m)))
        face = _faces(np.array(box.half_m))[2 * axis + (towards[axis] < 0.0)]
        for place, radius in _spheres(sphere):
            if sphere.half_m is not None and place[axis] * towards[axis] > 0.0:
                continue
            mbs.CreateSphereQuadContact(
                itemNumbers=[numbers[first], numbers[second]],
                localPosition0=place,
                sphereRadius=radius,
                quadPoints=face,
                contactStiffness=recipe.stiffness_N_m,
                dynamicFriction=scene.mu,
                frictionProportionalZone=recipe.zone_m_s,
                restitutionCoefficient=scene.restitution or 1.0,
                impactModel=MIXED if scene.restitution else LINEAR,
                contactDamping=0.0 if scene.restitution else PAD_DAMPING,
            )


def built(scene: Scene, recipe: Recipe, mbs: Any) -> tuple[dict[str, Any], list[tuple[float, Any, list[float]]]]:
    """Bodies by name and loads, at the start of the scene."""
    import exudyn as exu
    from exudyn.utilities import RigidBodyInertia

    numbers = {"": mbs.CreateGround()}
    for body, (velocity, rate) in zip(scene.bodies, initial_twists(scene).values(), strict=True):
        numbers[body.name] = mbs.CreateRigidBody(
            inertia=RigidBodyInertia(mass=body.mass_kg, inertiaTensor=np.diag(body.inertia_kg_m2)),
            referencePosition=list(body.position_m),
            initialVelocity=velocity.tolist(),
            initialAngularVelocity=rate.tolist(),
            nodeType=getattr(exu.NodeType, recipe.node),
        )
        joint = body.joint
        if joint is None:
            continue
        pair = [numbers[joint.parent], numbers[body.name]]
        add = mbs.CreateRevoluteJoint if joint.kind == "hinge" else mbs.CreatePrismaticJoint
        add(itemNumbers=pair, position=list(joint.anchor_m), axis=list(joint.axis), useGlobalFrame=True)
        if joint.damping:
            damping = (joint.damping * np.abs(joint.axis)).tolist()
            mbs.CreateCartesianSpringDamper(
                itemNumbers=pair,
                localPosition0=(np.array(joint.anchor_m) - np.array(scene.body(joint.parent).position_m)).tolist(),
                damping=damping,
            )
    loads = _push(mbs, scene, numbers)
    _touch(mbs, scene, numbers, recipe)
    if scene.weld:
        place = list(scene.body(scene.weld[1]).position_m)
        mbs.CreateGenericJoint(itemNumbers=[numbers[name] for name in scene.weld], position=place, useGlobalFrame=True)
    mbs.Assemble()
    return numbers, loads


def _push(mbs: Any, scene: Scene, numbers: dict[str, Any]) -> list[tuple[float, Any, list[float]]]:
    """Efforts of slides, a force on the body and its reaction on the parent: when it begins, load and vector."""
    loads = []
    for name, (effort, begin) in scene.efforts.items():
        joint = scene.body(name).joint
        force = effort * np.array(joint.axis)
        for body, sign in ((name, 1.0), (joint.parent, -1.0)):
            if body:
                load = mbs.CreateForce(itemNumber=numbers[body], loadVector=[0.0, 0.0, 0.0])
                loads.append((begin, load, (sign * force).tolist()))
    return loads


OUTPUTS = ("Position", "RotationMatrix", "Velocity", "AngularVelocity")


def _states(outputs: list[list[np.ndarray]]) -> States:
    """From the outputs of every body, in the order of ``OUTPUTS``."""
    from exudyn.rigidBodyUtilities import RotationMatrix2EulerParameters

    place, turn, v, w = (np.array(rows) for rows in zip(*outputs, strict=True))
    return States(place, np.array([RotationMatrix2EulerParameters(R.reshape(3, 3)) for R in turn]), v, w)


def states(scene: Scene, mbs: Any, numbers: dict[str, Any]) -> States:
    """Of every body."""
    import exudyn as exu

    kinds = [getattr(exu.OutputVariableType, name) for name in OUTPUTS]
    return _states(
        [[np.array(mbs.GetObjectOutputBody(numbers[body.name], kind)) for kind in kinds] for body in scene.bodies]
    )


def _links(scene: Scene) -> tuple[list[Any], list[float], dict[str, int]]:
    """Links of a tree whose base floats on six joints, their rates, and the numbers of the bodies' links."""
    import exudyn as exu
    from exudyn.rigidBodyUtilities import RigidBodyInertia, TreeLink

    base, kinds, none = scene.bodies[0], exu.JointType, RigidBodyInertia(0.0, np.zeros((3, 3)))
    names = ["PrismaticX", "PrismaticY", "PrismaticZ", "RevoluteZ", "RevoluteY", "RevoluteX"]
    rates = [*base.velocity_m_s, *reversed(base.rate_rad_s)]
    links = [TreeLink(none, getattr(kinds, name), parent=i - 1) for i, name in enumerate(names)]
    links[-1].linkInertia = RigidBodyInertia(base.mass_kg, np.diag(base.inertia_kg_m2))
    numbers = {base.name: len(links) - 1}
    for body in scene.bodies[1:]:
        parent, transform = scene.body(body.joint.parent), np.eye(4)
        transform[:3, 3] = np.array(body.joint.anchor_m) - frame_of(parent)
        inertia = RigidBodyInertia(body.mass_kg, np.diag(body.inertia_kg_m2))
        kind = getattr(kinds, "Revolute" + "XYZ"[int(np.argmax(body.joint.axis))])
        centred = inertia.Translated(np.array(body.position_m) - frame_of(body))
        links.append(TreeLink(centred, kind, jointHT=transform, parent=numbers[parent.name]))
        rates.append(body.joint.rate)
        numbers[body.name] = len(links) - 1
    return links, rates, numbers


def run_tree(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """As ``run``, of one free tree with hinges along the axes, in minimal coordinates."""
    import exudyn as exu
    from exudyn.itemInterface import SensorKinematicTree

    container = exu.SystemContainer()  # owns the system
    mbs = container.AddSystem()
    links, rates, numbers = _links(scene)
    tree = mbs.CreateKinematicTree(listOfTreeLinks=links, initialCoordinates_t=rates)
    sensors = [
        [
            mbs.AddSensor(
                SensorKinematicTree(
                    objectNumber=tree,
                    linkNumber=numbers[body.name],
                    localPosition=(np.array(body.position_m) - frame_of(body)).tolist(),
                    outputVariableType=getattr(exu.OutputVariableType, name),
                    writeToFile=False,
                )
            )
            for name in OUTPUTS
        ]
        for body in scene.bodies
    ]
    mbs.Assemble()
    settings = _settings(recipe)
    settings.timeIntegration.endTime = scene.duration_s
    settings.timeIntegration.numberOfSteps = round(scene.duration_s / step_s)
    clock = time.process_time()
    mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, recipe.solver), showHints=False)
    spent = time.process_time() - clock
    return [_states([[np.array(mbs.GetSensorValues(one)) for one in row] for row in sensors])], spent


def _settings(recipe: Recipe) -> Any:
    """No files, no numerical damping, accuracy of error control."""
    import exudyn as exu

    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.timeIntegration.relativeTolerance = settings.timeIntegration.absoluteTolerance = recipe.accuracy
    return settings


def run(scene: Scene, recipe: Recipe, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of ``SolveDynamic``."""
    import exudyn as exu

    container = exu.SystemContainer()  # owns the system
    mbs = container.AddSystem()
    numbers, loads = built(scene, recipe, mbs)
    settings = _settings(recipe)
    steps = settings.timeIntegration
    if not scene.touching:  # with contact, Newton's iteration ends at its default tolerances only
        steps.newton.useModifiedNewton = False
        steps.newton.relativeTolerance, steps.newton.absoluteTolerance = 1e-12, 1e-14
    found, spent, before = [], 0.0, 0.0
    for time_s in scene.times_s:
        for begin, load, vector in loads:
            if begin <= before:
                mbs.SetLoadParameter(load, "loadVector", vector)
        steps.startTime, steps.endTime = before, time_s
        steps.numberOfSteps = max(round((time_s - before) / step_s), 1)
        clock = time.process_time()
        mbs.SolveDynamic(
            settings, solverType=getattr(exu.DynamicSolverType, recipe.solver), updateInitialValues=True, showHints=False
        )
        spent += time.process_time() - clock
        before = time_s
        found.append(states(scene, mbs, numbers))
    return found, spent
