"""What a scenario says of the law ``playback``."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field, PositiveFloat, PositiveInt, field_validator, model_validator

from ffsm_controllers.playback.record import Interpolation
from ffsm_mj.controller_protocol import FileName, StrictModel

EffortUnit = Literal["N", "mN", "kN", "N m", "mN m", "kN m", "A m^2"]
TimeUnit = Literal["s", "ms", "us", "ns"]
FORCES, TORQUES, DIPOLES = get_args(EffortUnit)[:3], get_args(EffortUnit)[3:6], get_args(EffortUnit)[6:]
ColumnName = Annotated[str, Field(min_length=1)] | PositiveInt


class EffortColumnConfig(StrictModel):
    """A column of the file with the efforts of an actuator."""

    column: ColumnName | None = None
    """Name in the header, or position from 1; left out: the column of the actuator's name."""
    unit: EffortUnit | None = None
    """Unit of the numbers; left out: ``unit`` of the law, or the end of the column's name, as in ``tau_1_N_m``."""
    scale: float = 1.0
    """Factor on the numbers, such as -1 for the other direction."""

    @field_validator("scale")
    @classmethod
    def _is_not_zero(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("must not be 0: nothing would be played; leave the column out")
        return value


class TimeColumn(StrictModel):
    """When each sample is played."""

    column: ColumnName | None = None
    """Column with the times; left out: ``time_s`` or ``state.time_s``."""
    unit: TimeUnit | None = None
    """Unit of the times; left out: the end of the column's name, as in ``stamp_ms``."""
    step_s: PositiveFloat | None = None
    """In place of a column: time from sample to sample, s; the first one is at 0."""
    zero: Literal["file", "first_sample"] = "file"
    """Time 0 of the record is that of the file, or its first sample, as for stamps since an epoch."""
    since: Literal["phase", "run"] = "phase"
    """Time 0 of the record is played at the start of the phase, or of the run."""
    offset_s: float = 0.0
    """Added to the times, s; negative: the beginning of the record is left out."""

    @model_validator(mode="after")
    def _has_one_source(self) -> TimeColumn:
        if self.step_s is not None and (self.column is not None or self.unit is not None):
            raise ValueError("'step_s' stands in place of 'column' and 'unit'; leave it or them out")
        return self


class PlaybackConfig(StrictModel):
    """Recorded efforts from a file, whatever the robot does."""

    kind: Literal["playback"]
    file: FileName
    """CSV or Parquet file, or log or run folder of ffsm-mj, relative to the scenario file that names it."""
    columns: Annotated[dict[str, ColumnName | EffortColumnConfig], Field(min_length=1)] | None = None
    """Column of each actuator to drive, by the actuator; left out: every actuator with a column of its name, such as
    ``motor_1_N_m``, or as in our logs."""
    unit: EffortUnit | None = None
    """Unit of all columns that state none."""
    time: TimeColumn = TimeColumn()
    interpolation: Interpolation = "held"
    """``held``: each sample until the next one, from the first control tick at or after its time; ``mean``: each control
    tick has the mean of the held samples over its period, so that the impulse is exact; ``linear``: the same of straight
    lines between samples."""
    before: Literal["off", "hold"] = "off"
    """Until the first sample the actuators are off, or have its efforts."""
    after: Literal["off", "hold"] = "off"
    """After the record the actuators are off, or keep the last efforts. Held samples end as long after the last one as
    that comes after the one before it, straight lines at the last one."""
