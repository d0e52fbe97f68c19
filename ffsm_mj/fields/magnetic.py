"""Magnetic field of a scenario; see ``docs/orbit.md``."""

from __future__ import annotations

from datetime import UTC, datetime

from ffsm_mj._core.magnetic import Dipole, MagneticField, UniformMagneticField
from ffsm_mj.fields.config import DipoleConfig, MagneticConfig
from ffsm_mj.fields.orbit import Orbit

_J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
_DAY_S = 86400.0


def magnetic_field_of(config: MagneticConfig, orbit: Orbit | None, epoch: str | None) -> MagneticField:
    """The magnetic field of a scenario, of whose keys nothing is wrong."""
    if not isinstance(config, DipoleConfig):
        return UniformMagneticField(config.field_T)
    assert orbit is not None
    assert epoch is not None
    g10, g11, h11 = (1e-9 * value for value in config.coefficients_nT)
    days = (datetime.fromisoformat(epoch) - _J2000).total_seconds() / _DAY_S
    return Dipole(orbit.reference, orbit.axes, (g11, h11, g10), days)
