"""Observations: values of a run as one vector."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.gym.errors import EnvError
from ffsm_mj.gym.values import Values
from ffsm_mj.scenario.env_config import EnvConfig, ObservationConfig


class Observations:
    """The observation vector of an environment.

    Attributes:
        low: Least values, (n,).
        high: Greatest values, (n,).
        names: Name of the value of each entry, (n,).
    """

    def __init__(self, config: EnvConfig, values: Values) -> None:
        """Bind the parts of the observation vector to a run.

        Raises:
            ScenarioFaults: One fault per unknown name.
        """
        faults, self._readers, self.names = [], [], list[str]()
        bounds: list[tuple[float, float]] = []
        for i, part in enumerate(config.observations):
            each = part if isinstance(part, ObservationConfig) else ObservationConfig(of=part)
            try:
                read = values.reader(each.of)
            except LookupError as error:
                path = ("of",) if isinstance(part, ObservationConfig) else ()
                faults.append(Fault(str(error.args[0]), ("env", "observations", i, *path)))
                continue
            size = len(read(values.now()))
            self._readers.append(read)
            self.names += [each.of] if size == 1 else [f"{each.of}.{k}" for k in range(size)]
            bounds += [(each.low, each.high)] * size
        if faults:
            raise ScenarioFaults(faults)
        self.low, self.high = np.array(bounds).T

    def read(self, observation: Observation) -> FloatArray:
        """The observation vector, (n,), a new array.

        Raises:
            EnvError: A value is not finite.
        """
        vector = np.concatenate([read(observation) for read in self._readers])
        if not np.isfinite(vector).all():
            bad = [name for name, value in zip(self.names, vector, strict=True) if not np.isfinite(value)]
            raise EnvError(f"observation at t = {observation.time_s:.6g} s: not finite: {', '.join(bad)}")
        return vector
