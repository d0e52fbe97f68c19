"""Signals of a log as columns by name, and the motion in them as arrays."""

from __future__ import annotations

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import unknown_name
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import SUBSYSTEMS


class LoggedSignals:
    """Columns by name, ``signals["energy.total_J"]``; ``keys`` lists them, with ``units`` and ``descriptions``.

    Attributes:
        log: Contents of the log.
    """

    def __init__(self, log: RunLog) -> None:
        """Wrap a log."""
        self.log = log

    def __getitem__(self, key: str) -> FloatArray:
        """Column of a signal, one value per control tick.

        Raises:
            KeyError: No such signal; the message lists the names.
        """
        layout = self.log.header.layout
        if key not in layout.index:
            raise KeyError(unknown_name("signal", key, layout.keys))
        return self.log.column(key)

    def _ipython_key_completions_(self) -> list[str]:
        """Names of all columns: IPython and Jupyter complete ``run["`` with them."""
        return list(self.keys)

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of all columns."""
        return self.log.header.layout.keys

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {signal.key: signal.unit for signal in self.log.header.layout.signals}

    @property
    def descriptions(self) -> dict[str, str]:
        """Meaning of each column."""
        return {signal.key: signal.description for signal in self.log.header.layout.signals}

    @property
    def time(self) -> FloatArray:
        """Time of each row, s."""
        return self["state.time_s"]

    @property
    def qpos(self) -> FloatArray:
        """Generalised coordinates in MuJoCo's order, (n, nq)."""
        return self._columns("state.q_")

    @property
    def qvel(self) -> FloatArray:
        """Generalised velocities in MuJoCo's order, (n, nv)."""
        return self._columns("state.v_")

    @property
    def tip(self) -> FloatArray:
        """Position of the tip in m, world frame, (n, 3).

        Raises:
            KeyError: The scenario has no task and so no tip.
        """
        return np.column_stack([self[f"state.tip_{axis}_m"] for axis in "xyz"])

    @property
    def tip_velocity(self) -> FloatArray:
        """Velocity of the tip in m/s, world frame, (n, 3).

        Raises:
            KeyError: The scenario has no task and so no tip.
        """
        return np.column_stack([self[f"state.tip_v{axis}_m_s"] for axis in "xyz"])

    def momentum(self, subsystem: str = "total") -> FloatArray:
        """(P in N s, L about the world origin in N m s) of ``total``, ``robot`` or ``objects``, (n, 6).

        Raises:
            KeyError: No such subsystem.
        """
        if subsystem not in SUBSYSTEMS:
            raise KeyError(unknown_name("subsystem", subsystem, SUBSYSTEMS))
        return self._columns(f"momentum.{subsystem}_P_", f"momentum.{subsystem}_L_")

    def _columns(self, *prefixes: str) -> FloatArray:
        return np.asarray(self.log.rows[:, [i for i, key in enumerate(self.keys) if key.startswith(prefixes)]])
