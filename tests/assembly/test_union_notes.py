"""What the description of a scenario says of bodies of several pieces, and what it refuses."""

from __future__ import annotations

import pytest

from ffsm_mj.assembly.contact_rules import resolve_contacts
from ffsm_mj.assembly.union_notes import union_lines, union_notes
from ffsm_mj.errors import ScenarioFaults
from ffsm_mj.scenario.contacts import ContactsConfig
from tests.scenes import HEAD, ball, compile_paths


@pytest.fixture
def described(tmp_path):
    """Lines and notes of a ball over a floor of two plates, one of them higher by a step, and thinner."""

    def describe(step_m, weld_m, half_m=0.05):
        half = half_m + step_m / 2.0
        (tmp_path / "ball.xml").write_text(ball("ball"))
        (tmp_path / "floor.xml").write_text(
            f"""<mujoco>{HEAD}<worldbody><body name="floor"><freejoint name="free"/>
            <geom name="large" type="box" size="1 1 0.05" pos="-1 0 -0.05"/>
            <geom name="small" type="box" size="0.5 1 {half!r}" pos="0.5 0 {step_m - half!r}"/>
            </body></worldbody></mujoco>"""
        )
        system = compile_paths(tmp_path / "ball.xml", {"floor": tmp_path / "floor.xml"})
        contacts = resolve_contacts(ContactsConfig(weld_m=weld_m), system)
        return union_lines(contacts, system), list(union_notes(contacts, system))

    return describe


def test_what_is_welded_is_said(described):
    """Case 7 of the method: a step of 1 um is welded, and what was moved is printed."""
    lines, notes = described(1e-6, 1e-5)
    assert lines[0] == "  unions of convex pieces"
    assert lines[1].startswith("    floor: 2 pieces; ")
    assert lines[1].endswith("greatest move 1.0e-06 m")
    assert notes == []


def test_a_missed_weld_is_noted(described):
    lines, notes = described(5e-9, 1e-9)
    assert "move" not in lines[1]
    step = "a step of 5.0e-09 m between floor/large and floor/small"
    assert notes == [f"{step}: contacts.weld_m is smaller, and 1e-08 would weld them"]
    assert described(5e-9, 1e-8)[1] == []  # it does
    assert described(1e-6, 1e-9)[1] == []


def test_a_tolerance_that_would_melt_a_piece_is_refused(described):
    with pytest.raises(ScenarioFaults) as caught:
        described(0.0, 1e-3, 0.002)
    (fault,) = caught.value.faults
    assert fault.path == ("contacts", "weld_m")
    assert fault.message.startswith("small is 0.004 m thick: a welding tolerance of 0.001 m is more than a tenth of this")
