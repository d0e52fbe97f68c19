"""Coupled to the unit of a control law by a master that knows neither: libcosim, of the Open Simulation Platform."""

from __future__ import annotations

import fmpy
import numpy as np
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from pythonfmu import FmuBuilder

import ffsm_mj
from tests.fmu.masters import unit

LAW = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Law(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.place, self.rate, self.push = 0.0, 0.0, 0.0
        self.register_variable(Real("place", causality=Fmi2Causality.input))
        self.register_variable(Real("rate", causality=Fmi2Causality.input))
        self.register_variable(Real("push", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.push = 20.0 * (0.5 - self.place) - 2.0 * self.rate
        return True
"""
STEP_NS = 5_000_000


def places(file):
    return {one.name: one.valueReference for one in fmpy.read_model_description(str(file)).modelVariables}


def test_a_law_in_a_unit_of_its_own_closes_the_loop(tmp_path):
    """The master exchanges values between steps: the law computes over a step from the state at its beginning.

    A simulator with the same delay of one step has the same rows, bit for bit, through impacts.
    """
    (tmp_path / "law.py").write_text(LAW)
    law = FmuBuilder.build_FMU(tmp_path / "law.py", tmp_path / "law.fmu")
    plant = unit(tmp_path, "tap", {"duration_s": 2.0})
    of_plant, of_law = places(plant), places(law)
    master = CosimExecution.from_step_size(step_size=STEP_NS)
    tap = master.add_local_slave(CosimLocalSlave(fmu_path=str(plant), instance_name="tap"))
    control = master.add_local_slave(CosimLocalSlave(fmu_path=str(law), instance_name="law"))
    assert master.boolean_initial_value(tap, of_plant["robot/drive.external"], True)
    master.connect_real_variables(tap, of_plant["state.q_robot_stroke_m"], control, of_law["place"])
    master.connect_real_variables(tap, of_plant["state.v_robot_stroke_m_s"], control, of_law["rate"])
    master.connect_real_variables(control, of_law["push"], tap, of_plant["actuators.robot_drive_command_N"])
    seen = CosimObserver.create_last_value()
    master.add_observer(seen)
    shown, rows = [place for name, place in of_plant.items() if name.startswith("state.")], []
    for _ in range(399):
        assert master.step()
        rows.append(seen.last_real_values(tap, shown))

    simulator = ffsm_mj.Simulator("tap", {"duration_s": 2.0})
    simulator.reset()
    data, joint, expected, push = simulator.assembly.data, simulator.system.joints["robot/stroke"], [], 0.0
    for _ in range(399):
        place, rate = data.qpos[joint.qpos.start], data.qvel[joint.dofs.start]
        simulator.step({"drive": push})
        push = 20.0 * (0.5 - place) - 2.0 * rate
        expected.append(np.concatenate((data.qpos, data.qvel)))
    assert len(simulator.close().impacts) > 3
    assert np.array_equal(rows, expected)
