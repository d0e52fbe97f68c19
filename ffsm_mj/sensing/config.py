"""Configuration of a sensor in a scenario: errors and timing that its model file does not state."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.model.sensors import AddedKind, AddedSensor

Components = float | Annotated[tuple[float, ...], Field(min_length=1, max_length=4)]
"""One number for all components of a value, or one for each."""
Deviations = NonNegativeFloat | Annotated[tuple[NonNegativeFloat, ...], Field(min_length=1, max_length=4)]
"""Standard deviations, likewise."""


class FieldOfViewConfig(StrictModel):
    """A cone in which what is measured must be."""

    half_angle_rad: Annotated[float, Field(gt=0.0, le=math.pi)]
    """Half angle of the cone, rad."""
    site: Name
    """Site at its apex."""
    axis: Literal["x", "y", "z", "-x", "-y", "-z"] = "z"
    """Axis of the site along which the sensor looks."""


class SensorConfig(StrictModel):
    """Errors and timing of a sensor of a model; what is not given is as in the model file.

    Errors apply in this order: misalignment, scale, bias, noise, range and cutoff, quantum, dropout. For orientations they
    are rotation vectors in the measured frame, rad.
    """

    kind: AddedKind | None = None
    """For a sensor that no model file has, on any model: an element of MJCF, ``startracker`` or ``horizon``."""
    of: Name | None = None
    """With ``kind``: site, body (of frame sensors) or joint that it is on or measures."""
    relative_to: Name | None = None
    """With ``kind`` of a frame sensor: site or body in whose frame it measures; default: the world."""
    part: Literal["contact", "grasp", "tool"] | None = None
    """With ``kind: force`` or ``torque``: part of what comes through the site; default: all of it.

    ``contact`` is what contacts exert on the tool, which is all beyond the site; ``grasp`` what it holds exerts on it;
    ``tool`` the remainder, its inertia.
    """
    axes: Literal["world", "eci"] | None = None
    """With ``kind: startracker``: inertial axes in which it measures: ``world`` (default), or ``eci`` of the orbit."""
    interval_s: PositiveFloat | None = None
    """Time between samples, s; default: ``interval`` of the model file, or else the control period."""
    first_s: NonNegativeFloat | None = None
    """Time of the first sample, s."""
    delay_s: NonNegativeFloat | None = None
    """Time from a sample to its arrival at the control law, s; default: ``delay`` of the model file."""
    delay_jitter_s: NonNegativeFloat = 0.0
    """Upper end of a further delay, uniform from 0, drawn for each sample, s; samples may then arrive out of order."""
    misalignment_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector from the true frame to the frame in which the sensor measures, rad; values of three components."""
    scale_error: Components = 0.0
    """Relative error of the scale."""
    bias: Components = 0.0
    """Constant error, in the unit of the value."""
    bias_walk: NonNegativeFloat = 0.0
    """Random walk of the bias: its standard deviation after one second, in the unit of the value over sqrt(s)."""
    noise: Deviations | None = None
    """Standard deviation of the white noise of a sample, in the unit of the value, of all components or of each; default:
    ``noise`` of the model file."""
    noise_density: Deviations | None = None
    """In place of ``noise``: its density, in the unit of the value over sqrt(Hz); a sample has density / sqrt(interval)."""
    range: tuple[float, float] | None = None
    """Least and greatest value of a component; beyond it the sensor saturates."""
    cutoff: PositiveFloat | None = None
    """Greatest absolute value of a component; default: ``cutoff`` of the model file."""
    quantum: PositiveFloat | None = None
    """Resolution: components are rounded to multiples of it."""
    dropout: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Probability that a sample never arrives."""
    field_of_view: FieldOfViewConfig | None = None
    """What is measured must be in this cone, or the sample is not valid."""
    occlusion: bool = False
    """With ``field_of_view``: a geom of another body on the line of sight hides it."""

    @model_validator(mode="after")
    def _is_consistent(self) -> SensorConfig:
        if (self.kind is None) != (self.of is None):
            raise ValueError("'kind' and 'of' go together: they add a sensor")
        if self.relative_to is not None and not (self.kind or "").startswith("frame"):
            raise ValueError("'relative_to' needs a 'kind' that begins with 'frame'")
        if self.part is not None and self.kind not in ("force", "torque"):
            raise ValueError("'part' needs 'kind: force' or 'kind: torque'")
        if self.axes is not None and self.kind != "startracker":
            raise ValueError("'axes' are those in which a sensor of 'kind: startracker' measures")
        if self.noise is not None and self.noise_density is not None:
            raise ValueError("has both 'noise' and 'noise_density'; leave one of them out")
        if self.range is not None and not self.range[0] < self.range[1]:
            raise ValueError(f"range {list(self.range)} is empty; its first number must be the smaller one")
        if self.occlusion and self.field_of_view is None:
            raise ValueError("'occlusion' needs 'field_of_view', whose site the line of sight starts from")
        return self

    def added(self, name: str) -> AddedSensor | None:
        """The sensor to add under a name; None if it is one of a model file."""
        if self.kind is None or self.of is None:
            return None
        return AddedSensor(name, self.kind, self.of, self.relative_to or "")
