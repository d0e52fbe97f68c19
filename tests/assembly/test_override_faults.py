"""A fault at the key of an override begins with it; at another key it has its place, and the overrides are named behind."""

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
def test_a_fault_at_another_key_has_its_place_and_the_override(cause, key):
    lines = faults("baseline", cause)
    assert all(line.endswith(f" (with overrides: {cause})") for line in lines)
    assert any(".yaml:" in line.partition(key)[0] for line in lines if key in line)
    assert [line.partition(" (with")[0] for line in faults("baseline", "description=x", cause)] == [
        line.partition(" (with")[0] for line in lines
    ]


def test_a_fault_at_the_key_of_an_override_begins_with_it():
    (line,) = faults("baseline", "time_step_s=0.002", "control_period_s=0.003", "duration_s=3", "log.rerun=false")
    assert line.startswith("overrides: control_period_s=0.003: control_period_s: must be a multiple")
    assert "(with" not in line


def test_a_fault_of_a_file_keeps_its_place(tmp_path):
    path = two_balls(tmp_path)
    path.write_text(path.read_text() + "nonsense: 1\n")
    (line,) = faults(path, "duration_s=1")
    assert line.startswith(f"{path}:")


def test_a_key_that_an_override_asks_for_is_named_with_it():
    """The file has no task: the override makes one, in which a key is missing."""
    (line,) = faults("coasting", "task.tip=tip", "log.rerun=false")
    assert line == "overrides: task.tip=tip: task.target_m: is missing"


def test_a_fault_of_a_model_keeps_its_place(tmp_path):
    path = two_balls(tmp_path, duration_s=-1.0)
    model = tmp_path / "robot.xml"
    model.write_text(model.read_text().replace("<worldbody>", "<worldbody><wrong/>"))
    (line,) = faults(path, "duration_s=1")
    assert line.startswith(f"{model}:")
