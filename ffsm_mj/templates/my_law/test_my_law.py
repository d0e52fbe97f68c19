"""The law does what it says, and the balance of the run are closed."""

from __future__ import annotations

from pathlib import Path

import ffsm_mj
from ffsm_mj.pytest_plugin import assert_conserved

SCENARIO = Path(__file__).with_name("my_law.yaml")


def test_joints_come_to_rest() -> None:
    """The fastest joint has lost four fifths of its rate after 2 s; the checks of energy and momenta pass."""
    run = ffsm_mj.run(SCENARIO)
    fastest = run["controller.my_law_fastest_rad_s"]
    assert run.outcome == "completed"
    assert fastest[-1] < 0.2 * fastest[0]
    assert_conserved(run)
