"""Arms in space for tests of the core."""

from __future__ import annotations

import mujoco

ARM = """<mujoco><option gravity="0 0 0" {options}/>
<default><geom type="capsule" fromto="0 0 0 .5 0 0" size=".05" mass="1"/></default>
<worldbody><body name="base"><freejoint name="free"/><geom fromto="-.2 0 0 .2 0 0" size="0.1" mass="5"/>
<body name="link_1" pos="0.2 0 0"><joint name="j1" axis="0 0 1" {joint}/><geom/>
<body name="link_2" pos="0.5 0 0"><joint name="j2" axis="0 1 0"/><geom/>
<body name="link_3" pos="0.5 0 0"><joint name="j3" axis="0 0 1"/><geom/><site name="tip" pos=".5 0 0"/>
</body></body></body></body></worldbody>{rest}</mujoco>"""
MOTORS = "<actuator>" + "".join(f'<motor name="m{i}" joint="j{i}"/>' for i in (1, 2, 3)) + "</actuator>"


def moving(system, rng):
    """Data at a random state, with random efforts."""
    data = mujoco.MjData(system.mj)
    mujoco.mj_integratePos(system.mj, data.qpos, rng.uniform(-1.0, 1.0, system.mj.nv), 1.0)
    data.qvel[:] = rng.uniform(-0.5, 0.5, system.mj.nv)
    data.ctrl[:] = rng.uniform(-2.0, 2.0, system.mj.nu)
    mujoco.mj_forward(system.mj, data)
    return data
