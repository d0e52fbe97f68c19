"""The two loops that are compared: ``mj_step`` on a scenario's model and nothing else, and the whole run in memory.

Both are told in seconds of CPU time: they are one thread each, and other work on the machine does not count.
"""

from __future__ import annotations

import time

import mujoco

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import PreparedRun
from ffsm_mj.assembly.run import simulate

ARM_RATE = 0.1


def steps(prepared: PreparedRun) -> int:
    """Integration steps of a scenario."""
    return prepared.scenario.ticks * prepared.scenario.steps_per_tick


def fresh(prepared: PreparedRun, *, contacts: bool) -> Assembly:
    """A scenario at its start, with MuJoCo's contacts or without."""
    assembly = prepared.assemble()
    model, bit = assembly.system.mj, int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.disableflags = model.opt.disableflags & ~bit if contacts else model.opt.disableflags | bit
    return assembly


def stir(assembly: Assembly) -> None:
    """Set every joint of the robot but those of its base going, rad/s."""
    robot = assembly.system.robot
    assembly.data.qvel[robot.base_dofs.stop : robot.dofs.stop] = ARM_RATE


def bare(prepared: PreparedRun, *, contacts: bool = True, stirred: bool = True) -> float:
    """As many steps as the scenario has, by mj_step in a Python loop, no efforts."""
    assembly = fresh(prepared, contacts=contacts)
    if stirred:
        stir(assembly)
    model, data = assembly.system.mj, assembly.data
    start = time.process_time()
    for _ in range(steps(prepared)):
        mujoco.mj_step(model, data)
    return time.process_time() - start


def in_memory(prepared: PreparedRun) -> float:
    """The scenario with everything on, its log kept in memory; set-up is not counted."""
    assembly = prepared.assemble()
    start = time.process_time()
    run = simulate(assembly)
    spent = time.process_time() - start
    assert run.outcome == "completed", run.outcome
    return spent
