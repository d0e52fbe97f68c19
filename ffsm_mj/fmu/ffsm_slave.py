"""The class that PythonFMU loads from the resources of a unit, into whose folder this file is copied."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

try:
    from ffsm_mj.fmu.co_simulation import CoSimulation, CoSimulationState, RefusedStep
    from ffsm_mj.fmu.description import model_description
    from ffsm_mj.fmu.unit_file import check_resources
except ImportError as missing:
    raise ImportError(f"this unit runs in a Python with ffsm-mj, which this one has not: {missing}") from missing


class FfsmSlave(Fmi2Slave):
    """One instance of a unit."""

    def __init__(self, **kwargs: Any) -> None:
        """Read the scenario of the unit."""
        super().__init__(**kwargs)
        folder = Path(self.resources)
        about = check_resources(folder)
        self._run = CoSimulation(folder / "scenario")
        self.modelName, self.guid, self._about = about["name"], about["guid"], about
        self._start_s = 0.0

    def to_xml(self, model_options: Any = None) -> Any:  # noqa: ARG002
        """Model description, with units, bounds and all that the standard asks for."""
        description = model_description(self._about, self._run.ports)
        self._run.close()  # it is asked for where a unit is written, of an instance that runs nothing
        return description

    def setup_experiment(self, start_time: float, stop_time: float | None = None, tolerance: float | None = None) -> None:  # noqa: ARG002
        """Note the start time."""
        self._start_s = start_time

    def exit_initialization_mode(self) -> None:
        """Begin the run."""
        self._run.begin(self._start_s)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Simulate over a step; False, and a message, if it was not made."""
        try:
            self._run.step(current_time, step_size)
        except RefusedStep as refusal:
            self.log(str(refusal), Fmi2Status.discard)
            return False
        return True

    def terminate(self) -> None:
        """End the run, and its log."""
        self._run.close()

    def _values(self, vrs: list[int]) -> list[Any]:
        return self._run.get(vrs)

    def _set(self, vrs: list[int], values: list[Any]) -> None:
        for place, value in zip(vrs, values, strict=True):
            self._run.set(place, value)

    get_real = get_integer = get_boolean = get_string = _values
    set_real = set_integer = set_boolean = set_string = _set

    def _get_fmu_state(self) -> CoSimulationState:
        return self._run.get_state()

    def _set_fmu_state(self, state: CoSimulationState) -> None:
        self._run.set_state(state)

    @staticmethod
    def _fmu_state_to_bytes(state: CoSimulationState) -> bytes:
        return state.to_bytes()

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> CoSimulationState:
        return CoSimulationState.from_bytes(state)
