"""Units under FMPy's own slave class, by names of variables."""

from __future__ import annotations

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

import ffsm_mj
from ffsm_mj.fmu.unit_file import write_unit


def unit(folder, scenario, overrides=()):
    """A scenario as a unit; its file."""
    file = folder / "unit.fmu"
    write_unit(ffsm_mj.Scenario.load(scenario, overrides), file)
    return file


class Instance:
    """An instance of a unit, with the messages that it logged."""

    def __init__(self, file, start_s=0.0, folder=None, messages=None, name="instance", **values):
        """Instantiate, set parameters and inputs, and initialize."""
        description = fmpy.read_model_description(str(file))
        self.places = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.types = {variable.name: variable.type for variable in description.modelVariables}
        self.messages = [] if messages is None else messages
        # Kept alive as long as the unit may call it.
        self._callbacks = fmi2CallbackFunctions(logger=fmi2CallbackLoggerTYPE(self._note))
        self.slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder or fmpy.extract(str(file)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.slave.instantiate(callbacks=self._callbacks, loggingOn=True)
        self.slave.setupExperiment(startTime=start_s)
        self.slave.enterInitializationMode()
        self.set(**values)
        self.slave.exitInitializationMode()
        self.time_s = start_s

    def _note(self, _environment, _name, _status, _category, message):
        self.messages.append(message.decode())

    def set(self, **values):
        """Set variables."""
        for name, value in values.items():
            getattr(self.slave, f"set{self.types[name]}")([self.places[name]], [value])

    def __getitem__(self, name):
        """Value of a variable."""
        (value,) = getattr(self.slave, f"get{self.types[name]}")([self.places[name]])
        return value.decode() if isinstance(value, bytes) else value

    def numbers(self, start):
        """Values of the real outputs whose names begin so, (n,)."""
        places = [place for name, place in self.places.items() if name.startswith(start) and self.types[name] == "Real"]
        return np.array(self.slave.getReal(places))

    def step(self, step_s):
        """Take a step from where the master is."""
        self.slave.doStep(self.time_s, step_s)
        self.time_s += step_s
