"""Cost of the equality constraints of a gripper: runs with them over runs of the same model without them.

``uv run python benchmarks/mechanisms.py``: process time of runs in memory, medians of interleaved ones. The gripper is a
linkage of eight hinges on a free bus, with seven rows of rank five, as two-finger grippers have: two connects that close a
four-bar linkage at each finger, in space, and a coupling of both drivers. Both runs start at the same state. A tick is one
step of 1 ms with balances and log, with a motor and with a servo that is so stiff that steps are implicit. ``bare`` is
``mj_step`` by RK4 alone, with MuJoCo's own soft constraints in the one case.
"""

# ruff: noqa: E402

from __future__ import annotations

from ffsm_mj.cli.main import one_blas_thread

one_blas_thread()

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import mujoco
from scenes import run_s

from ffsm_mj.assembly.prepare import PreparedRun, prepare

TICKS = 2000
ACTUATORS = {
    "motor": '<motor name="drive" tendon="split"/>',
    "servo": '<position name="drive" tendon="split" kp="100" kv="10" forcerange="-5 5"/>',
}
FOLLOWER, COUPLER = "0 .055 .0375", "0 .0315 -.0041"
"""Place of a follower on its spring link, and of a coupler on its driver, m."""


def _link(name: str, pos: str, mass: float, centre: str, about: float, inner: str = "") -> str:
    return (
        f'<body name="{name}" pos="{pos}"><joint name="{name}" axis="1 0 0" armature=".001" damping=".001"/>'
        f'<inertial pos="{centre}" mass="{mass}" diaginertia="{about} {about} {about}"/>{inner}</body>'
    )


def _finger(side: str, turn: str) -> str:
    coupler = _link(f"{side}_coupler", COUPLER, 0.014, "0 .003 .023", 4e-6)
    follower = _link(f"{side}_follower", FOLLOWER, 0.016, "0 -.011 .016", 3e-6)
    return (
        f'<body name="{side}" pos="0 0 .055" {turn}><inertial pos="0 0 0" mass=".01" diaginertia="1e-5 1e-5 1e-5"/>'
        + _link(f"{side}_driver", "0 .0306 0", 0.009, "0 .018 .001", 2e-6, coupler)
        + _link(f"{side}_spring", "0 .0132 .006", 0.022, "0 .018 .021", 8e-6, follower)
        + "</body>"
    )


def gripper(actuator: str = "motor") -> str:
    """A bus of 20 kg with the linkage."""
    fingers = _finger("right", "") + _finger("left", 'euler="0 0 180"')
    pins = "".join(
        f'<connect body1="{side}_follower" body2="{side}_coupler" anchor="0 -.018 .0065"/>' for side in ("right", "left")
    )
    return (
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="bus"><freejoint name="bus"/>'
        '<inertial pos="0 0 0" mass="20" diaginertia="1 1.1 1.2"/>'
        f"{fingers}</body></worldbody>"
        f'<equality>{pins}<joint joint1="right_driver" joint2="left_driver"/></equality>'
        '<tendon><fixed name="split"><joint joint="left_driver" coef=".5"/><joint joint="right_driver" coef=".5"/></fixed>'
        "</tendon>"
        f"<actuator>{ACTUATORS[actuator]}</actuator></mujoco>"
    )


def prepared(folder: Path, actuator: str, *, rows: bool) -> PreparedRun:
    """One driver closes at .2 rad/s; with the rows all others follow."""
    (folder / f"{actuator}.xml").write_text(gripper(actuator))
    rates = {"bus": [0.01, 0.0, 0.02, 0.1, -0.05, 0.02], "left_driver": 0.2}
    scenario = {
        "name": "gripper",
        "duration_s": TICKS * 1e-3,
        "control_period_s": 1e-3,
        "robot": {"mjcf": f"{actuator}.xml"} | ({} if rows else {"strip": ["equalities"]}),
        "contacts": {"rules": []},
        "initial": {"rates": rates},
        "phases": [{"name": "coast", "until": "end", "controller": {"kind": "off"}}],
    }
    path = folder / f"{actuator}-{rows}.yaml"
    path.write_text(json.dumps(scenario))
    return prepare(path)


def bare_s(*, rows: bool) -> float:
    """Process time of as many steps by MuJoCo alone, s."""
    model = mujoco.MjModel.from_xml_string(gripper())
    model.opt.timestep, model.opt.integrator = 1e-3, int(mujoco.mjtIntegrator.mjINT_RK4)
    if not rows:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    data = mujoco.MjData(model)
    data.qvel[6:] = 0.2
    began = time.process_time()
    for _ in range(TICKS):
        mujoco.mj_step(model, data)
    return time.process_time() - began


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=9, help="runs of each kind")
    repeats = parser.parse_args().repeats
    for actuator in ACTUATORS:
        with tempfile.TemporaryDirectory() as folder:
            both = [prepared(Path(folder), actuator, rows=rows) for rows in (True, False)]
            for run in both:
                run_s(run)  # imports
            times = [tuple(run_s(run) for run in both) for _ in range(repeats)]
        with_rows, without = (1e6 / TICKS * statistics.median(each) for each in zip(*times, strict=True))
        print(f"{actuator}: {with_rows:.1f} us per tick with rows, {without:.1f} without, ratio {with_rows / without:.2f}")
    times = [(bare_s(rows=True), bare_s(rows=False)) for _ in range(repeats)]
    soft, without = (1e6 / TICKS * statistics.median(each) for each in zip(*times, strict=True))
    print(f"bare: {soft:.1f} us per step with soft rows, {without:.1f} without, ratio {soft / without:.2f}")


if __name__ == "__main__":
    main()
