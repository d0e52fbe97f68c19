"""A fault that an override causes names it, wherever the fault appears; a fault of the file does not."""

from __future__ import annotations

import pytest

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.scenes import two_balls


def faults(path, *overrides):
    with pytest.raises(InputError) as caught:
        prepare(path, overrides)
    return caught.value.lines


@pytest.mark.parametrize(
    ("cause", "key"),
    [
        ("time_step_s=0.003", "control_period_s: must be a multiple"),  # combined with another key
        ("objects={}", "initial.joints."),  # once the models are known
        ("contacts.rules=[]", "until"),
    ],
)
def test_the_override_that_causes_a_fault_elsewhere_is_named(cause, key):
    alone = faults("baseline", cause)
    assert all(line.startswith(f"overrides: {cause}: ") for line in alone)
    assert any(key in line for line in alone)
    # Among others it is found by leaving out one at a time.
    assert faults("baseline", "description=x", cause, "stop_on_impact=true") == alone


def test_two_overrides_that_cause_it_together_are_both_named():
    """Either alone is valid: 2 ms are a multiple of 1 ms, and 3 ms of 1 ms, but 3 ms are none of 2 ms."""
    (line,) = faults("baseline", "time_step_s=0.002", "control_period_s=0.003", "duration_s=3", "log.rerun=false")
    assert line.startswith("overrides: control_period_s=0.003: control_period_s: must be a multiple")
    (line,) = faults("baseline", "time_step_s=0.002", "phases.0.for_s=3")
    assert line.startswith("overrides: time_step_s=0.002: ")


def test_a_fault_of_the_file_is_not_blamed_on_an_override(tmp_path):
    path = two_balls(tmp_path)
    path.write_text(path.read_text() + "nonsense: 1\n")
    (line,) = faults(path, "duration_s=1")
    assert line.startswith(f"{path}:")


def test_a_fault_that_another_one_hides_without_the_override_is_not_blamed_on_it(tmp_path):
    """The model is wrong in any case, and without the override the file is refused before the model is read."""
    path = two_balls(tmp_path, duration_s=-1.0)
    model = tmp_path / "robot.xml"
    model.write_text(model.read_text().replace("<worldbody>", "<worldbody><wrong/>"))
    (line,) = faults(path, "duration_s=1")
    assert line.startswith(f"{model}:")
