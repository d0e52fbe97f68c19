"""The register of kinds of records: names are unique, and every kind can be stored in a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from ffsm_mj.contact_models.registry import BUILT_IN_RECORDS
from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import RecordKind, faults, field_of, kind_of, kinds, kinds_of, register
from ffsm_mj.records.record import ByName, Values, declared, record


@record
class Push:
    """A record for tests."""

    time_s: float = declared("Time.")
    by: str = declared("Who pushes.")
    point_m: Values = declared("Where.", components="xyz")
    forces_N: ByName = declared("Forces.", entries={"total": 1})


KIND = RecordKind(
    record=Push,
    name="push",
    plural="pushes",
    when="at every push",
    time=lambda push: push.time_s,
    sentence=lambda push: f"a push by {push.by}",
)


@pytest.fixture(autouse=True)
def _registered_for_one_test(monkeypatch):
    monkeypatch.setattr(register_of_kinds, "_KNOWN", {})
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


def made(**declared: tuple[Any, Any]) -> type:
    """A record with some fields, each with its type and its declaration."""
    fields = {name: how for name, (_, how) in declared.items() if how is not None}
    return record(type("Made", (), {"__annotations__": {name: hint for name, (hint, _) in declared.items()}, **fields}))


TIME = (float, declared("Time."))


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
    ],
)
def test_reserved_names_and_names_of_other_kinds_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        register(replace(KIND, **changed))
    assert kinds() == (KIND,)


@pytest.mark.parametrize(
    ("declared", "words"),
    [
        ({"deep": (tuple[Values, ...], declared("Deep."))}, "a log cannot hold a tuple"),
        ({"speed_m_s": (float, None)}, "the field speed_m_s has no meaning"),
        ({"speed_m_s": (float, declared("Speed.", components="xyz"))}, "speed_m_s has components, but one value"),
        ({"speed_m_s": (float, declared("Speed.", entries={"total": 1}))}, "speed_m_s has entries, but is no mapping"),
        ({"speed_m_s": (float, declared("Speed.", column_after="mass_kg"))}, "no field mass_kg for speed_m_s to come after"),
        ({"speed_m_s": (float, declared("Speed.", column_after="speed_m_s"))}, "no field speed_m_s for speed_m_s"),
        ({"words": (Mapping[str, str], declared("Words."))}, None),
        ({"speed_m_s": (float, declared("Speed.", column=False))}, None),
    ],
)
def test_an_inconsistent_declaration_is_refused(declared, words):
    if words is None:
        register(replace(KIND, name="pull", plural="pulls", record=made(time_s=TIME, **declared)))
        return
    with pytest.raises(ValueError, match=words):
        register(replace(KIND, name="pull", plural="pulls", record=made(time_s=TIME, **declared)))
    assert kinds() == (KIND,)


def test_kinds_of_every_run_have_no_faults():
    """Their registration, at each import, takes it for granted."""
    assert {kind.name: list(faults(kind)) for kind in BUILT_IN_RECORDS} == {kind.name: [] for kind in BUILT_IN_RECORDS}


def test_a_table_has_columns():
    with pytest.raises(ValueError, match="the table pulls has no columns"):
        register(replace(KIND, name="pull", plural="pulls", record=made(qpos=(Values, declared("Configuration.")))))


def test_the_default_summary_has_all_fields():
    push = Push(1.0, "hand", (0.0, 0.5, 0.0), {"total": (2.0,)})
    assert KIND.summary(push) == {"time_s": 1.0, "by": "hand", "point_m": [0.0, 0.5, 0.0], "forces_N": {"total": [2.0]}}


def test_a_column_is_derived_from_its_field():
    assert field_of("angular_impulse_{xyz}_N_m_s") == ("angular_impulse_N_m_s", "xyz")
    assert field_of("normal_{xyz}") == ("normal", "xyz")
    assert field_of("impulse_N_s") == ("impulse_N_s", "")
