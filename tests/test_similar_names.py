"""The name that was probably meant by one that does not exist."""

from __future__ import annotations

import pytest

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
