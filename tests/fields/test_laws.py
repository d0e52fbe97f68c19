"""Control laws know the external fields: the drift of the task model, and the output of OSDRE."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_controllers.osdre.law import Osdre, OsdreConfig
from ffsm_mj._core.fields import FieldForces
from ffsm_mj.controller_protocol import Command, ControllerContext, Observation, Task
from ffsm_mj.fields.interface import Uniform
from ffsm_mj.simulation.fields import bodies_of, moving_bodies
from ffsm_mj.task_model import TaskModel
from tests.fields.fields import FIELDS_OF_TESTS
from tests.scenes import HEAD, scene

LINK = """<body name="{0}" pos="0.3 0 0"><joint name="{0}" axis="0 {1} 1"/>
  <inertial pos="0.15 0.02 0" mass="{2}" diaginertia="0.01 0.02 0.02"/>"""
ARM = f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="9" diaginertia="0.5 0.6 0.7"/>{LINK.format("a", 0, 2.0)}{LINK.format("b", 0.3, 1.0)}
  {LINK.format("c", 0, 0.8)}<site name="tip" pos="0.3 0 0"/></body></body></body></body></worldbody>
  <actuator><motor name="a" joint="a"/><motor name="b" joint="b"/><motor name="c" joint="c"/></actuator></mujoco>"""
STIRRING = {"fields": [{"kind": "stirring"}, {"kind": "uniform", "acceleration_m_s2": [0.1, -0.2, 0.05]}]}


@pytest.fixture(name="plant")
def _plant(tmp_path, rng):
    """An arm in a general state under fields, assembled."""
    path = scene(tmp_path, ARM, {}, environment=STIRRING)
    ffsm_mj.run(path, {"duration_s": 0.001}, fields=FIELDS_OF_TESTS)
    plant = ffsm_mj.Scenario.load(path).prepared.assemble().plant
    plant.data.qpos[7:], plant.data.qvel[:] = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.3, 0.3, 9)
    mujoco.mj_forward(plant.system.mj, plant.data)
    plant.integrator.restart()
    return plant


def context_of(plant, axes):
    system, fields = plant.system, plant.integrator.sources[0]
    task = Task(system.index("site", "tip"), axes, np.zeros(len(axes)))
    return ControllerContext(system, task, 1e-3, external_field=fields.forces_in(system))


def test_the_drift_is_the_acceleration_without_effort(plant):
    context = context_of(plant, (0, 1, 2))
    model = TaskModel(context)
    model.update(plant.data)
    np.testing.assert_allclose(model.coasting, plant.data.qacc, atol=1e-12)
    blind = TaskModel(replace(context, external_field=None))
    blind.update(plant.data)
    assert np.abs(blind.drift - model.drift).max() > 1e-2


@pytest.mark.parametrize("axes", [(0, 1), (0, 1, 2)])
def test_osdre_takes_the_field_as_it_takes_springs(plant, axes):
    context, data = context_of(plant, axes), plant.data
    p = len(axes)
    config = OsdreConfig(kind="osdre", Q=[1.0] * 2 * p, R=[1.0] * 3)
    observation = Observation(0.0, data)
    efforts = []
    for known in (context, replace(context, external_field=None)):
        law, command = Osdre(config, known), Command.off(3)
        law.start(observation)
        law.control(observation, command)
        efforts.append(np.array(command.effort))
    assert np.abs(efforts[0] - efforts[1]).max() > 1e-6
    # The same force as a passive one is taken the same way by a law that knows no field.
    force = np.zeros(plant.system.mj.nv)
    context.external_field.add_to(data, force)
    data.qfrc_passive[:] += force
    law, command = Osdre(config, replace(context, external_field=None)), Command.off(3)
    law.start(observation)
    law.control(observation, command)
    np.testing.assert_allclose(command.effort, efforts[0], rtol=1e-9, atol=1e-12)


def test_computed_torque_holds_the_tip_under_a_field(tmp_path):
    # The tip stays where it is while the base falls beneath it: without the field in the drift it would sag by a / kp.
    law = {"kind": "task_ct", "position": {"kp_1_s2": 25.0, "kd_1_s": 10.0}}
    task = {"tip": "tip", "axes": ["x", "y"], "target_m": [0.9, 0.0]}
    keys = {
        "duration_s": 1.0,
        "environment": {"fields": [{"kind": "uniform", "acceleration_m_s2": [0.0, 0.02, 0.0]}]},
        "phases": [{"name": "hold", "until": "end", "controller": law}],
        "initial": {"joints": {"a": 0.4, "b": -0.8, "c": 0.6}},
    }
    start = ffsm_mj.run(scene(tmp_path, ARM, {}, **keys | {"duration_s": 0.001, "task": task}))
    task["target_m"] = [float(start[f"state.tip_{axis}_m"][0]) for axis in "xy"]
    run = ffsm_mj.run(scene(tmp_path, ARM, {}, **keys, task=task))
    error = np.hypot(run["state.tip_x_m"] - task["target_m"][0], run["state.tip_y_m"] - task["target_m"][1]).max()
    # Efforts held over ticks of 1 ms sag by the change of drift in a tick; a / kp would be 8e-4 m.
    assert error < 1e-5
    assert abs(run["state.q_robot_free_y_m"][-1]) > 5e-3


def test_forces_in_another_system_are_the_same(plant):
    fields, system = plant.integrator.sources[0], plant.system
    own, direct = np.zeros(system.mj.nv), np.zeros(system.mj.nv)
    fields.forces_in(system).add_to(plant.data, own)
    bodies, (ids, trees) = bodies_of(system), moving_bodies(system)
    uniform = Uniform(Uniform.Config(kind="uniform", acceleration_m_s2=(0.0, 0.0, -1.0)), bodies)
    FieldForces(system.mj, plant.data, ids, trees, bodies, [uniform], np.zeros((1, 7))).add_to(plant.data, direct)
    # A uniform acceleration of everything is that of the base alone.
    M = np.zeros((system.mj.nv, system.mj.nv))
    mujoco.mj_fullM(system.mj, plant.data, M)
    np.testing.assert_allclose(np.linalg.solve(M, direct), [0, 0, -1.0, *[0] * 6], atol=1e-12)
    applied = plant.data.qfrc_applied
    np.testing.assert_allclose(own, applied, atol=1e-12)
