"""Docstrings of attributes, as the descriptions of the JSON Schema."""

from __future__ import annotations

from pydantic import Field

from ffsm_mj.attribute_docstrings import attribute_docstrings
from ffsm_mj.config import StrictModel


class Base(StrictModel):
    mass_kg: float
    """Mass
    of all."""
    plain: int = 0


def made() -> type[StrictModel]:
    class Local(Base):
        mass_kg: float
        """Its own."""
        other: float = Field(description="As stated.")
        """Not this."""

        def method(self) -> None:
            inside: int = 0
            """No attribute."""
            assert inside == 0

    return Local


def test_a_class_has_its_own_and_those_of_its_bases():
    assert attribute_docstrings(Base)["mass_kg"] == "Mass\nof all."
    found = attribute_docstrings(made())
    assert (found["mass_kg"], found["other"]) == ("Its own.", "Not this.")
    assert not {"plain", "inside"} & found.keys()


def test_they_describe_the_keys_of_a_schema_unless_a_field_says_more():
    keys = made().model_json_schema()["properties"]
    assert [keys[name].get("description") for name in ("mass_kg", "plain", "other")] == ["Its own.", None, "As stated."]


def test_a_class_without_source_has_those_of_its_bases():
    assert attribute_docstrings(type("Made", (Base,), {"__module__": "nowhere"})) == attribute_docstrings(Base)
