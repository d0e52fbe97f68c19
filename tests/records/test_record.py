"""A field of a record is declared once: log, tables and pages follow."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, is_dataclass

import pytest

from ffsm_mj.contact_models.registry import BUILT_IN_RECORDS
from ffsm_mj.records.record import (
    ByName,
    Meaning,
    Values,
    columns_of,
    declared,
    in_table_order,
    lengths_of,
    meanings,
    record,
)

PLACE = Meaning("Place in world axes.", components="xyz")


@record
class Push:
    """A record for tests."""

    number: int = declared("Number of the push.")
    time_s: float = declared("Time of the push.")
    step: int = declared("Step.", column=False)
    geoms: tuple[str, ...] = declared("Two geoms.", components="ab")
    place_m: Values = declared(PLACE)
    normal: Values = declared("Unit normal.", components="xyz")
    slip_m_s: Values = declared("Slip.", components="xy")
    force: Values = declared("Force.", unit="N", components="xyz")
    names: tuple[str, ...] = declared("Names.")
    qpos: Values = declared("Configuration.")
    momentum: ByName = declared("P and L.", entries={"total": 6, "robot": 3})
    word: str = declared("``hard`` or ``soft``.", default="hard", column_after="number")
    origin_m: Values = declared(PLACE, column_after="place_m", default=(0.0, 0.0, 0.0))
    goal_m: Values = declared(PLACE, column=False, default=(0.0, 0.0, 0.0))


def test_columns_follow_from_the_fields():
    """In their order, late ones where they belong; the letters of components before the unit."""
    assert columns_of(Push) == {
        "number": ("", "number of the push"),
        "word": ("", "hard or soft"),
        "time_s": ("s", "time of the push"),
        "geoms_{ab}": ("", "two geoms"),
        "place_{xyz}_m": ("m", "place in world axes"),
        "origin_{xyz}_m": ("m", "place in world axes"),
        "normal_{xyz}": ("", "unit normal"),
        "slip_{xy}_m_s": ("m/s", "slip"),
        "force_{xyz}": ("N", "force"),
        "names": ("", "names"),
    }
    assert list(columns_of(Push))[:5] == ["number", "word", "time_s", "geoms_{ab}", "place_{xyz}_m"]
    assert in_table_order(Push)[:3] == ("number", "word", "time_s")


def test_lengths_follow_from_the_fields():
    assert lengths_of(Push) == {
        "geoms": 2,
        "place_m": 3,
        "normal": 3,
        "slip_m_s": 2,
        "force": 3,
        "origin_m": 3,
        "goal_m": 3,
        "momentum.total": 6,
        "momentum.robot": 3,
    }


def test_a_record_is_a_frozen_dataclass_with_the_defaults_of_its_fields():
    push = Push(1, 0.5, 3, ("a", "b"), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0), (1.0, 0.0, 0.0), ("a",), (), {})
    assert (is_dataclass(push), push.word, push.origin_m) == (True, "hard", (0.0, 0.0, 0.0))
    with pytest.raises(AttributeError):
        push.number = 2
    with pytest.raises(TypeError, match="missing 11 required"):
        Push()


def test_records_extend_others():
    @record
    class Shove(Push):
        """A push with a force."""

        force_N: float = declared("Force.", default=0.0)

    assert list(meanings(Shove)) == [*meanings(Push), "force_N"]
    assert columns_of(Shove) == columns_of(Push) | {"force_N": ("N", "force")}


@pytest.mark.parametrize("kind", BUILT_IN_RECORDS, ids=lambda kind: kind.name)
def test_fields_of_built_in_records_say_what_they_mean(kind):
    """In sentences."""
    told = meanings(kind.record)
    assert list(told) == [field.name for field in fields(kind.record)]
    assert all(meaning.text.endswith(".") for meaning in told.values())


@pytest.mark.long(one_of=8)
@pytest.mark.parametrize("before", ["", "import ffsm_mj.contact_models.grasp.records, ffsm_mj.records.events"])
@pytest.mark.parametrize("module", ["log.recorder", "log.mcap.reader", "log.mcap.sink", "assembly.plant"])
def test_who_handles_logs_knows_the_built_in_kinds_in_their_order(before, module):
    """The registry starts empty, and the order does not depend on what is imported first."""
    program = f"{before}\nfrom ffsm_mj.records.kinds import kinds\nassert not kinds()\nimport ffsm_mj.{module}\n"
    program += "print(*(kind.name for kind in kinds()))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout.split() == [kind.name for kind in BUILT_IN_RECORDS]
    assert found.stdout.startswith("impact contact_begins ")
