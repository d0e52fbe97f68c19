"""The register of kinds of records: names are unique, and every kind can be stored in a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import pytest

from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import RecordKind, field_of, kind_of, kinds, kinds_of, register


@dataclass(frozen=True)
class Push:
    """A record for tests."""

    time_s: float
    by: str
    point_m: tuple[float, ...]
    forces_N: Mapping[str, tuple[float, ...]]


KIND = RecordKind(
    record=Push,
    name="push",
    plural="pushes",
    when="at every push",
    time=lambda push: push.time_s,
    sentence=lambda push: f"a push by {push.by}",
    columns={"time_s": ("s", "when"), "point_{xyz}_m": ("m", "where")},
    lengths={"point_m": 3, "forces_N.total": 1},
)


@pytest.fixture(autouse=True)
def _registered_for_one_test(monkeypatch):
    monkeypatch.setattr(register_of_kinds, "_known", lambda known={}: known)
    register(KIND)


def test_a_kind_is_found_by_record_and_by_name():
    push = Push(1.0, "hand", (0.0, 0.0, 0.0), {})
    assert kind_of(push) is KIND
    assert (KIND.topic, KIND.schema) == ("/ffsm/push", "ffsm.Push")
    assert replace(KIND, name="long_push").schema == "ffsm.LongPush"
    assert kinds() == kinds_of(["push"]) == (KIND,)
    assert kinds_of(()) == ()
    with pytest.raises(TypeError, match="float is not a kind of record; there are push"):
        kind_of(1.0)
    with pytest.raises(KeyError, match="unknown kind of record 'pish'"):
        kinds_of(["pish"])


def test_registering_a_kind_again_has_no_effect():
    register(replace(KIND))
    assert kinds() == (KIND,)


@dataclass(frozen=True)
class Pull:
    """A second record class."""

    time_s: float
    deep: tuple[tuple[float, ...], ...] = ()


class Plain:
    """A class that is not a dataclass."""


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"when": "now and then"}, "is push already"),
        ({"name": "shove", "plural": "shoves"}, "is push already"),
        ({"name": "shove", "record": Plain}, "is push already"),
        ({"name": "sample", "plural": "pulls", "record": Plain}, "the name is reserved"),
        ({"name": "pull", "plural": "tip", "record": Plain}, "the name is reserved"),
        ({"name": "pull", "plural": "pulls", "record": Plain}, "Plain is not a dataclass"),
        ({"name": "pull", "plural": "pulls", "record": Pull}, "a log cannot hold a tuple"),
    ],
)
def test_reserved_names_and_names_of_other_kinds_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        register(replace(KIND, **changed))
    assert kinds() == (KIND,)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"columns": {"speed_m_s": ("m/s", "none")}}, "no field speed_m_s for the column"),
        ({"columns": {"point_m": ("m", "three")}}, "point_m has several"),
        ({"columns": {"point_{xy}_m": ("m", "two")}}, "lengths does not say"),
        ({"columns": {}}, "the table pushes has no columns"),
        ({"lengths": {"point_m": 3, "normal": 3}}, "no field normal"),
    ],
)
def test_an_inconsistent_kind_is_refused(monkeypatch, changed, words):
    monkeypatch.setattr(register_of_kinds, "_known", lambda known={}: known)
    with pytest.raises(ValueError, match=words):
        register(replace(KIND, **changed))


def test_the_default_summary_has_all_fields():
    push = Push(1.0, "hand", (0.0, 0.5, 0.0), {"total": (2.0,)})
    assert KIND.summary(push) == {"time_s": 1.0, "by": "hand", "point_m": [0.0, 0.5, 0.0], "forces_N": {"total": [2.0]}}


def test_a_column_is_derived_from_its_field():
    assert field_of("angular_impulse_{xyz}_N_m_s") == ("angular_impulse_N_m_s", "xyz")
    assert field_of("normal_{xyz}") == ("normal", "xyz")
    assert field_of("impulse_N_s") == ("impulse_N_s", "")
