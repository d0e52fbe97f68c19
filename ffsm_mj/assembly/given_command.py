"""Commands of a program that steps a simulation: efforts by actuator, checked before the simulation sees them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.controller_protocol import Command, GivenCommand
from ffsm_mj.errors import InputError, described
from ffsm_mj.model.system import System


def given_command(system: System, given: Any) -> GivenCommand:
    """Command from what a program gives.

    Args:
        system: Robot and objects.
        given: A :class:`Command`; or an array (nu,) of efforts in N or N m, which power all actuators; or a mapping of names
            to efforts: of an actuator, or of a model, such as ``robot``, to the efforts of all its actuators. A mapping
            powers the actuators that it names and leaves the others to the control laws of the phase; None in place of an
            effort switches an actuator off. A :class:`GivenCommand` is taken as it is, unchecked.

    Raises:
        InputError: It has another shape, names no actuator, or is not finite.
    """
    if isinstance(given, GivenCommand):
        return given
    count = int(system.mj.nu)
    command, named = Command.off(count), np.ones(count, dtype=np.bool_)
    if isinstance(given, Command):
        command.drive(slice(None), _efforts(system, given.effort, range(count), "command"))
        np.copyto(command.powered, given.powered)
        command.requests.update(given.requests)
    elif isinstance(given, Mapping):
        named[:] = False
        for name, effort in given.items():
            _take(system, command, named, name, effort)
    else:
        command.drive(slice(None), _efforts(system, given, range(count), "command"))
    return GivenCommand(command, named)


def _take(system: System, command: Command, named: Any, name: Any, effort: Any) -> None:
    """Write the efforts of one name of a mapping."""
    ids = _actuators(system, name)
    if named[ids].any():
        raise InputError(f"command: {name!r} names actuators that another name gives too")
    named[ids] = True
    if effort is not None:
        command.drive(ids, _efforts(system, effort, ids, f"command of {name!r}"))


def _actuators(system: System, name: Any) -> Any:
    """Ids of the actuators that a name stands for."""
    names = system.names("actuator")
    of_model = [i for i, full in enumerate(names) if full.split("/", 1)[0] == name and full != name]
    if of_model:
        return np.array(of_model)
    try:
        return np.array([system.index("actuator", name)])
    except LookupError as error:
        models = sorted({full.split("/", 1)[0] for full in names if "/" in full})
        raise InputError(f"command: {error.args[0]}; or a model: {', '.join(models)}") from error


def _efforts(system: System, given: Any, ids: Iterable[int], what: str) -> FloatArray:
    """Finite efforts of some actuators."""
    names = [system.names("actuator")[i] for i in ids]
    try:
        efforts = np.atleast_1d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: not numbers ({described(error)})") from error
    if efforts.shape != (len(names),):
        raise InputError(f"{what}: shape {efforts.shape}, but one effort each is needed for {', '.join(names)}")
    bad = [f"{name} {value}" for name, value in zip(names, efforts, strict=True) if not np.isfinite(value)]
    if bad:
        raise InputError(f"{what}: efforts must be finite: {', '.join(bad)}")
    return efforts
