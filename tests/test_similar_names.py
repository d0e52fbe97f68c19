"""The name that was probably meant by one that does not exist."""

from __future__ import annotations

import pytest

from ffsm_mj.errors import unknown_name
from ffsm_mj.similar_names import did_you_mean, similar_file, similar_name


@pytest.mark.parametrize(
    ("written", "names", "meant"),
    [
        ("aproach", ["approach", "regulate"], "approach"),
        ("Approach", ["approach", "regulate"], "approach"),
        ("mi", ["mu", "restitution"], "mu"),  # one of two letters: too much for a measure of similarity
        ("um", ["mu", "restitution"], "mu"),
        ("m", ["mu", "restitution"], "mu"),
        ("x", ["e", "restitution"], ""),
        ("tp", ["robot/tip", "robot/base"], "robot/tip"),  # without the prefix of its model
        ("joints", ["q.joints", "rates"], "q.joints"),
        ("dur", ["duration_s", "name"], "duration_s"),
        ("zzz", ["duration_s", "name"], ""),
        ("", ["mu"], ""),
    ],
)
def test_the_meant_name(written, names, meant):
    assert similar_name(written, names) == meant
    assert did_you_mean(written, names) == (f" (did you mean {meant!r}?)" if meant else "")


def test_the_meant_file(tmp_path):
    (tmp_path / "mine.yaml").touch()
    assert similar_file(tmp_path / "mime.yaml") == f" (did you mean {str(tmp_path / 'mine.yaml')!r}?)"
    assert similar_file(tmp_path / "mine.yml") == f" (did you mean {str(tmp_path / 'mine.yaml')!r}?)"
    assert similar_file(tmp_path / "other.yaml") == ""  # the suffix alone is not similar
    assert similar_file(tmp_path / "nowhere" / "mine.yaml") == ""


def test_of_many_names_a_message_shows_the_most_similar():
    """All of 20, in the order of the alphabet; of 21 ten, the one that was meant first."""
    names = [f"state.q_joint_{i}_rad" for i in range(20)]
    assert unknown_name("signal", "q_joint_7_rd", names).partition("; allowed: ")[2].split(", ") == sorted(names)
    text = unknown_name("signal", "q_joint_7_rd", [*names, "energy.total_J"])
    listed = text.partition("; allowed: ")[2]
    assert listed.startswith("state.q_joint_7_rad, ")
    assert listed.endswith(" and 11 more")
    assert listed.count(",") == 9
    assert "energy" not in text
