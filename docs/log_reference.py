"""Prints docs/log-reference.md from the code: ``uv run python docs/log_reference.py > docs/log-reference.md``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import get_args, get_origin, get_type_hints

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.log import foxglove as viewer
from ffsm_mj.log.drawing import NOMINAL_M
from ffsm_mj.log.markers import ARROW_M, SHOWN_S, marks_topic
from ffsm_mj.log.mcap import format as form
from ffsm_mj.records.kinds import kinds
from ffsm_mj.records.record import ControllerReport, meanings
from ffsm_mj.records.signals import GROUPS, unit_of

HEAD = """# Log reference

Generated from the code by `uv run python docs/log_reference.py`; a test verifies that it is current.

Every topic of `run.mcap` but `/ffsm/state` is protobuf; the file contains the schemas. `log_time` and `publish_time` are
simulation time in ns. Vectors are in world axes, angular momentum is about the world origin. Quaternions of `ffsm.*` are
wxyz as in MuJoCo, those of `foxglove.*` xyzw. Names end in their unit.
"""


def viewer_topics() -> dict[str, tuple[str, str]]:
    """When there is a message on a topic for viewers, and what it holds, in the order of the file."""
    length = f"between {ARROW_M[0]} and {ARROW_M[1]} m for a robot of {NOMINAL_M:g} m"
    about = {
        viewer.TRANSFORMS_TOPIC: (
            "at `log.view_rate_hz`, 50 Hz by default",
            "pose of every body in the frame `world`; frames have the names of the bodies, such as `robot/base`",
        ),
        viewer.SCENE_TOPIC: (
            "once, with the first frame",
            "the visible geoms of each body as primitives or triangles, fixed in the body's frame; "
            "a cross at the task's target; collision geoms that visual geoms cover are left out",
        ),
        viewer.ARROWS_TOPIC: (
            "at every frame with a loaded contact, and at the next one",
            "an arrow for every loaded pair, along the force on its second geom and ending at the centre of pressure; "
            f"1 m is 1 N {length}; each message replaces all earlier ones",
        ),
        viewer.PLUMES_TOPIC: (
            "when the set of firing thrusters changes, evaluated once per frame; "
            "at every frame while one on a joint of the base fires",
            "a cone at every firing thruster; each message replaces all earlier ones",
        ),
        viewer.LOG_TOPIC: ("at every event", "every record, and the outcome, as text; `name` is `ffsm`"),
    }
    for kind in kinds():
        drawn = f"the content of `{kind.topic}` as arrows with a text for {SHOWN_S:g} s; 1 m is 1 unit {length}"
        about[marks_topic(kind)] = (f"with `{kind.topic}`", drawn)
    about[f"{viewer.OUTLINE_TOPIC}/<body>"] = (
        "once, with the first frame",
        "the edges of the body's geoms as coloured points in its frame, for Rerun, which does not draw scene updates",
    )
    return {topic: about[topic] for topic in (*viewer.viewer_topics(kinds()), f"{viewer.OUTLINE_TOPIC}/<body>")}


CONTENT = f"""## Attachments and metadata

| record | name | content |
|---|---|---|
| attachment | `{form.SCENARIO_ATTACHMENT}` | the resolved scenario; it can be run with the attached models |
| attachment | `mjcf/<robot or object>/...` | every model file; [pieces](shapes.md#what-is-kept) of meshes |
| metadata | `{form.RUN_METADATA}` | versions, start of the run (UTC), task, phases, whether the models are conservative |
| metadata | `{form.SIGNALS_METADATA}` | `unit \\| description` of every field of `{form.SAMPLE_TOPIC}` |

The metadata of the channel `{form.SAMPLE_TOPIC}` contain the record `{form.RUN_METADATA}` again, protected by a checksum.
"""


def reference() -> Iterator[str]:
    """The page, part by part."""
    yield HEAD
    yield "## Topics\n"
    yield table(("topic", "schema", "when"), topics())
    yield CONTENT
    yield f"## {form.SAMPLE_TOPIC}\n"
    yield f"`{form.SAMPLE_SCHEMA}`, one per control tick: a message per group, every field a double and always present.\n"
    yield (
        "The fields of `baseline`. Other models have their own joints, actuators and controllers in the same groups.\n"
        "Scenarios with fixed bodies have six columns each of `balance.fixed_on_robot_...` and\n"
        "`balance.fixed_on_objects_...`, their impulses. With gravity there are three columns\n"
        "`balance.total_gravity_work_J` and so on, and six each of `balance.gravity_on_robot_...` and\n"
        "`balance.gravity_on_objects_...`: its work and its impulses, which the residuals subtract. [External\n"
        "fields](fields.md) have the same columns, with `field` in place of `gravity`; an orbit has the group\n"
        "`orbit`, see [orbits](orbit.md#log). With springs and\n"
        "dampers of joints there are three columns each of `energy.total_elastic_J`, `balance.total_damper_heat_J` and\n"
        "`balance.total_spring_truncation_J`, see [Flexible joints](joints.md#energy-of-springs-and-dampers).\n"
        "Where an object has actuators, `balance.objects_work_J` is their work and\n"
        "`balance.external_on_objects_...` the impulse of its thrusters; `balance.work_J` and\n"
        "`balance.external_...` are those of the robot. With rules that\n"
        "have `mu` above 0 there is `balance.friction_heat_J`, the heat of friction: that of sliding in persistent\n"
        "contact, the sum of `contact.<rule>_heat_J`, and the kinetic energy lost in impacts with friction, minus the work\n"
        "of their normal impulses; and `balance.contact_work_J`, the work of the forces of persistent contact.\n"
        "Servos have a setpoint in place of the effort in the group `actuators`, in the unit of their joint or without\n"
        "one, and further columns `actuators.<servo>_unclamped_...` and `..._force_...`, their force before and after the\n"
        "limits of the model file, and `..._activation`, see [Servos](joints.md#servos-in-the-log).\n"
        "Magnetorquers have dipoles in A m^2\n"
        "and their torques in world axes, `..._torque_x_N_m`.\n"
        "Loads of equality constraints are in the group `contact`, see [mechanisms](mechanisms.md#loads-in-the-log).\n"
        "\n"
        f"Models with sensors have the group `sensor`, {GROUPS['sensor']}; with an\n"
        f"estimator there is the group `estimate`, {GROUPS['estimate']}: their fields are in\n"
        "[Sensors and delays](sensors.md#in-the-log) and [State estimation](state-estimation.md). Runs in\n"
        "[real time](stepping.md#real-time) have the group `clock`.\n"
    )
    for group, fields_of_group in samples().items():
        yield f"### {group}: {GROUPS[group]}\n"
        yield table(("field", "unit", "meaning"), fields_of_group)
    for kind in kinds():
        yield f"## {kind.topic}\n"
        yield f"`{kind.schema}`, {kind.when}.\n"
        yield table(("field", "type", "unit", "meaning"), record(kind.record))
    yield "## Viewer topics\n"
    yield "[Foxglove's schemas](https://docs.foxglove.dev/docs/sdk/schemas), for Foxglove, Lichtblick and, in part, Rerun.\n"
    yield table(("topic", "content"), [(f"`{topic}`", text) for topic, (_, text) in viewer_topics().items()])


def topics() -> Iterator[tuple[str, str, str]]:
    """Every topic in the order of the file."""
    yield f"`{form.SAMPLE_TOPIC}`", f"`{form.SAMPLE_SCHEMA}`", "every control tick (`control_period_s`)"
    for kind in kinds():
        yield f"`{kind.topic}`", f"`{kind.schema}`", kind.when
    saved = "with `log: {states: events}` at every event: the state of the simulation, from which a run goes on"
    yield f"`{form.STATE_TOPIC}`", f"none; encoding `{form.STATE_ENCODING}`, JSON after a line with its version", saved
    messages = viewer.viewer_topics(kinds())
    for topic, (when, _) in viewer_topics().items():
        yield f"`{topic}`", f"`{messages.get(topic, viewer.PointCloud).DESCRIPTOR.full_name}`", when


def samples() -> dict[str, list[tuple[str, str, str]]]:
    """Fields of a sample of the baseline by group."""
    assembly = prepare("baseline").assemble()
    found: dict[str, list[tuple[str, str, str]]] = {}
    for signal in assembly.row.layout.signals:
        found.setdefault(signal.group, []).append((f"`{signal.name}`", signal.unit, signal.description))
    return found


def record(record_type: type) -> Iterator[tuple[str, str, str, str]]:
    """Fields of an event."""
    found, hints = meanings(record_type), get_type_hints(record_type)
    for field in fields(record_type):
        meaning = found[field.name]
        unit, text = meaning.unit or unit_of(field.name), meaning.text.replace("``", "`")
        yield f"`{field.name}`", type_name(hints[field.name]), unit, text


def type_name(hint: object) -> str:
    """Protobuf's word for a field of an event."""
    words = {float: "double", int: "int64", str: "string"}
    if hint in words:
        return words[hint]
    parts = get_args(hint)
    if get_origin(hint) is tuple:
        return f"{words[parts[0]]}[]"
    return f"map of {'string' if parts[1] in (str, ControllerReport) else 'double[]'}"


def table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]] | list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


if __name__ == "__main__":
    print("\n".join(reference()), end="")
