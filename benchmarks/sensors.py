"""Cost of sensors: a free arm with ten sensors at 100 Hz against one without, at ticks of 1 ms.

``uv run python benchmarks/sensors.py``: ratios of process time, the best of several interleaved runs. Sensors
that are sampled once show what their columns in the log and the clock cost at every tick; the rest is that of samples.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from ffsm_mj.assembly.prepare import prepare

_ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="base"/>
  <geom type="box" size=".3 .3 .3" mass="50"/><site name="imu" pos=".1 .05 .02"/>
  <body name="link" pos=".3 0 0"><joint name="j1" axis="0 1 0"/>
  <geom type="capsule" size=".05" fromto="0 0 0 .5 0 0" mass="3"/>
  <body name="hand" pos=".5 0 0"><joint name="j2"/><site name="wrist"/><geom type="sphere" size=".08" pos=".2 0 0" mass="1"/>
  </body></body></body></worldbody><sensor>{}</sensor></mujoco>"""
_TIMING = 'interval="0.01" noise="0.01"'
_SENSORS = "".join(
    f"<{kind} {of} {_TIMING}/>"
    for kind, of in (
        ("gyro", 'site="imu"'),
        ("accelerometer", 'site="imu"'),
        ("jointpos", 'joint="j1"'),
        ("jointpos", 'joint="j2"'),
        ("jointvel", 'joint="j1"'),
        ("jointvel", 'joint="j2"'),
        ("framepos", 'objtype="site" objname="imu"'),
        ("framequat", 'objtype="site" objname="imu"'),
        ("force", 'site="wrist"'),
        ("torque", 'site="wrist"'),
    )
)
_SCENE = """name: arm
duration_s: 5.0
robot: {mjcf: arm.xml}
initial: {rates: {j1: 0.3, j2: 0.2}}
contacts: {rules: []}
phases: [{name: coast, until: end, controller: {kind: "off"}}]
"""


def measured(repeats: int) -> list[float]:
    """Least process time of a tick without sensors, with ten that are sampled once, and with ten at 100 Hz, s."""
    with TemporaryDirectory() as folder:
        prepared = []
        for sensors in ("", _SENSORS.replace('interval="0.01"', 'interval="100"'), _SENSORS):
            (Path(folder) / "arm.xml").write_text(_ARM.format(sensors))
            (Path(folder) / "scene.yaml").write_text(_SCENE)
            prepared.append(prepare(Path(folder) / "scene.yaml"))
        best = [float("inf")] * len(prepared)
        for _ in range(repeats):
            for i, each in enumerate(prepared):
                started = time.process_time()
                each.run()
                best[i] = min(best[i], time.process_time() - started)
    return [each / 5000 for each in best]


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=12)
    without, once, often = (1e6 * each for each in measured(parser.parse_args().repeats))
    print(
        f"{without:.1f} us without, {once:.1f} us with ten sensors sampled once: {once / without:.2f}, "
        f"{often:.1f} us with ten at 100 Hz: {often / without:.2f}"
    )


if __name__ == "__main__":
    main()
