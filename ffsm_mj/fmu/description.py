"""Model description of a unit: the XML file by which a master knows its variables (FMI 2.0.4, section 2.2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from ffsm_mj.fmu.ports import Port

_BASE_UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s^2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "s": {"s": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "N s": {"kg": 1, "m": 1, "s": -1},
    "N m s": {"kg": 1, "m": 2, "s": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "kg": {"kg": 1},
    "T": {"kg": 1, "s": -2, "A": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "A m^2": {"A": 1, "m": 2},
}
"""Exponents of the base units of each unit; one that is not here has no definition but its name."""
_CATEGORIES = {"logStatusDiscard": "steps that were not made", "logStatusError": "errors", "logAll": "all messages"}
_OPTIONS = (
    *("needsExecutionTool", "canHandleVariableCommunicationStepSize", "canNotUseMemoryManagementFunctions"),
    *("canGetAndSetFMUstate", "canSerializeFMUstate"),
)
"""What a unit can do, or needs: a Python with ffsm-mj is its execution tool."""
_INITIAL = {"parameter": "exact", "output": "calculated"}


def model_description(about: Mapping[str, Any], ports: Sequence[Port]) -> Element:
    """Element of a unit.

    Args:
        about: ``name`` (an identifier), ``guid``, ``description``, ``version`` of ffsm-mj, ``stop_s`` and ``period_s``.
        ports: Variables; their places are their value references.
    """
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=about["name"],
        guid=about["guid"],
        description=about["description"],
        generationTool=f"ffsm-mj {about['version']}",
        variableNamingConvention="flat",
    )
    SubElement(root, "CoSimulation", {"modelIdentifier": about["name"], **dict.fromkeys(_OPTIONS, "true")})
    units = SubElement(root, "UnitDefinitions")
    for unit in sorted({port.unit for port in ports} - {""}):
        definition = SubElement(units, "Unit", name=unit)
        if exponents := _BASE_UNITS.get(unit):
            SubElement(definition, "BaseUnit", {name: str(exponent) for name, exponent in exponents.items()})
    categories = SubElement(root, "LogCategories")
    for name, text in _CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=text)
    times = {"startTime": about["start_s"], "stopTime": about["stop_s"], "stepSize": about["period_s"]}
    SubElement(root, "DefaultExperiment", {name: repr(value) for name, value in times.items()})
    variables = SubElement(root, "ModelVariables")
    variables.extend(_variable(port, place) for place, port in enumerate(ports))
    structure = SubElement(root, "ModelStructure")
    outputs = [place for place, port in enumerate(ports, 1) if port.causality == "output"]
    for kind in ("Outputs", "InitialUnknowns"):
        _unknowns(SubElement(structure, kind), outputs)
    return root


def _unknowns(of: Element, places: Iterable[int]) -> None:
    for place in places:
        SubElement(of, "Unknown", index=str(place))


def _variable(port: Port, place: int) -> Element:
    """Element of a variable. Outputs are computed from the initial state; what is no real number changes at events."""
    varies = "fixed" if port.causality == "parameter" else "continuous" if port.kind == "Real" else "discrete"
    variable = Element(
        "ScalarVariable",
        name=port.name,
        valueReference=str(place),
        description=port.description,
        causality=port.causality,
        variability=varies,
    )
    if port.causality in _INITIAL:
        variable.set("initial", _INITIAL[port.causality])
    of_type = SubElement(variable, port.kind)
    if port.unit:
        of_type.set("unit", port.unit)
    for name, bound in (("min", port.least), ("max", port.greatest)):
        if bound is not None:
            of_type.set(name, repr(bound))
    if port.causality != "output":
        of_type.set("start", str(port.start).lower() if port.kind == "Boolean" else str(port.start))
    return variable
