"""Motors by every transmission of MJCF, rotors, and springs and dampers: what acts in a run is entered in its balance."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from tests.model.mjcf_cases import mjcf, written
from tests.scenes import scene

TRANSMISSIONS = {
    "gear": {"actuator/motor": {"gear": "3"}},
    "rotor of a motor": {"actuator/motor": {"armature": "0.2", "gear": "3"}},
    "delay": {"actuator/motor": {"delay": "0.01", "nsample": "20"}},
    "limits": {"actuator/motor": {"forcerange": "-.2 .2", "gear": "2"}},
    "fixed tendon": {"in_actuator": '<motor name="x" tendon="tf" gear="2" armature="0.1"/>'},
    "spatial tendon": {"in_actuator": '<motor name="x" tendon="ts" armature="0.1"/>'},
    "inertia of tendons": {"tendon/fixed": {"armature": "0.3"}, "tendon/spatial": {"armature": "0.2"}},
    "two sites": {"in_actuator": '<motor name="x" site="t2" refsite="s" gear="1 0.5 0 0.2 0 0.3"/>'},
    "site": {"in_actuator": '<motor name="x" site="t2" gear="1 0.5 0 0.2 0 0.3"/>'},
    "slider-crank": {"in_actuator": '<motor name="x" cranksite="t2" slidersite="s" cranklength="1"/>'},
    "ball joint in its parent": {"in_actuator": '<motor name="x" jointinparent="jb" gear="0.1 0 0.2"/>'},
    "free joint in its parent": {"in_actuator": '<motor name="x" jointinparent="free" gear="0.1 0 0.2"/>'},
    "spring and damper": {"body/joint": {"springdamper": "0.5 1", "ref": "30", "pos": ".1 .2 .3", "armature": "0.1"}},
    "polynomials": {"body/joint": {"stiffness": "1 2 3", "springref": "20", "damping": ".1 .2 .3"}},
}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("what", TRANSMISSIONS)
def test_what_acts_is_entered_in_the_balance(tmp_path, what):
    """A run with efforts of every transmission that is accepted passes its energy and momentum checks."""
    case = TRANSMISSIONS[what]
    names = ["m", "g", *(["x"] if "in_actuator" in case else [])]
    signs = [(-1) ** (k // 2) * (1.0 + 0.1 * k) for k in range(10)]
    rows_played = [
        f"{0.01 * k:.2f}," + ",".join(f"{s * (1 - 0.3 * i)}" for i in range(len(names))) for k, s in enumerate(signs)
    ]
    (tmp_path / "efforts.csv").write_text("\n".join((",".join(("time_s", *names)), *rows_played)))
    written(tmp_path, "")
    rates = {"free": [0.1, -0.2, 0.1, 0.3, 0.2, -0.4], "j1": 0.5, "j2": -1.0, "jb": [1.0, -0.7, 0.4]}
    columns = {name: {"column": name, "unit": "N" if name == "x" and "ball" not in what else "N m"} for name in names}
    playback = {"kind": "playback", "file": "efforts.csv", "columns": columns}
    path = scene(tmp_path, mjcf(**case), {}, duration_s=0.1, time_step_s=5e-4, initial={"rates": rates},
        phases=[{"name": "play", "until": "end", "controller": playback}])  # fmt: skip
    run = ffsm_mj.run(path, rerun=False)
    assert [check.name for check in all_checks(run) if not check.passes] == []
    assert {"energy", "linear momentum", "angular momentum"} <= {check.name for check in all_checks(run)}
