"""Paths of the models and scenarios that ship with ffsm-mj, in a checkout and in an installed wheel."""

from __future__ import annotations

from pathlib import Path

from ffsm_mj.errors import InputError, unknown_name
from ffsm_mj.similar_names import similar_file

_PACKAGE = Path(__file__).resolve().parents[1]

_OTHERS = {
    ".xml": "a model, not a scenario: name it in one under robot.mjcf or objects.NAME.mjcf",
    ".urdf": "a model, not a scenario: name it in one under robot.mjcf or objects.NAME.mjcf",
    ".mcap": "the log of a run, not a scenario: its run folder runs again",
    ".rrd": "a recording for the Rerun viewer, not a scenario",
}


def scenarios_dir() -> Path:
    """Folder of the shipped scenarios; models are in ``mjcf/`` beside it, so relative paths are valid in both layouts."""
    inside_wheel = _PACKAGE / "scenarios"
    return inside_wheel if inside_wheel.is_dir() else _PACKAGE.parent / "scenarios"


def scenario_names() -> tuple[str, ...]:
    """Names that ``ffsm run NAME`` accepts, sorted."""
    return tuple(sorted(path.stem for path in scenarios_dir().glob("*.yaml")))


def scenario_path(scenario: str | Path) -> Path:
    """Path of a scenario given as a path, as a run folder (its ``scenario.yaml``), or as the name of a shipped one.

    A string with a separator or a YAML suffix is a path; any other word is a name, unless a file of that name exists, or
    a folder while no shipped scenario has that name.

    Raises:
        InputError: Neither a file nor a shipped scenario.
    """
    path, text = Path(scenario), str(scenario)
    if not text:
        raise InputError("'': an empty name; name a scenario file, or a shipped scenario")
    try:
        if path.is_file():
            if path.suffix.lower() in _OTHERS:
                raise InputError(f"{text}: is {_OTHERS[path.suffix.lower()]}")
            return path
    except OSError as error:  # a name that is too long, a folder that may not be read
        raise InputError(f"{text}: cannot be read ({error.strerror})") from error
    if path.is_dir() and text not in scenario_names():
        inside = path / "scenario.yaml"
        if not inside.is_file():
            raise InputError(f"{text}: is a folder without a {inside.name}; name a scenario file or a run folder")
        return inside
    if path.suffix in (".yaml", ".yml") or "/" in text or path.name != text:
        raise InputError(f"{text}: no such scenario file{similar_file(path)}")
    if text not in scenario_names():
        raise InputError(f"{text}: no such file, and {unknown_name('shipped scenario', text, scenario_names())}")
    return scenarios_dir() / f"{text}.yaml"
