"""Inputs of controllers: each is the control of an actuator of its own.

MuJoCo's ``<pid>`` and ``<dcmotor>`` have a control for each input, so that controls, actuators and forces of a model would
have different indices. Here each further input gets an actuator without force, ``<servo>.vel`` or the like, right behind
its servo: then every index of an actuator is that of its control and of its force, in commands, limits, logs and laws.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco

from ffsm_mj.arrays import BoolArray

_GAIN = mujoco.mjtGain
_TOKENS = (("pos", 1), ("vel", 2), ("ff", 4), ("voltage", 8))
"""Inputs in the order of their controls, with their bits of a signature (mjtCtrlInput)."""
_NONE, _VOLTAGE = int(mujoco.mjtCtrlInput.mjINPUT_NONE), int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE)
_DEFAULT = {_GAIN.mjGAIN_PID: 3, _GAIN.mjGAIN_DCMOTOR: _VOLTAGE}
"""Signatures of controllers that state none."""
_NOT_COPIED = ("id", "signature", "name", "compiler", "plugin", "classname")
_TRANSMISSION = ("trntype", "target", "refsite", "slidersite", "cranklength", "gear", "info")
NO_VOLTAGE = 1e-300
"""End of the range of a motor without inputs, until the scene is compiled: MuJoCo allows no range that is empty."""


def signature_inputs(gaintype: Any, signature: int) -> tuple[str, ...]:
    """Inputs of a controller by the type of its gain and its signature; empty for another servo, or without inputs."""
    kind = _GAIN(int(gaintype))
    if kind not in _DEFAULT:
        return ()
    return tuple(token for token, bit in _TOKENS if (int(signature) or _DEFAULT[kind]) & bit)


def ambiguous_inputs(spec: Any) -> Iterator[tuple[str, str, str]]:
    """Controllers of a specification one of whose further inputs has the name of an actuator: kind, name, and what."""
    names = {one.name for one in spec.actuators}
    for one in spec.actuators:
        for token in signature_inputs(one.gaintype, one.ctrlspec)[1:]:
            if (name := f"{one.name}.{token}") in names:
                yield "actuator", one.name, f" has an input {name!r}, and so is another actuator called; rename it"


def separate_inputs(spec: Any) -> dict[str, str]:
    """Give each further input of the controllers of a specification an actuator, and a motor without inputs a voltage of 0.

    Controllers of several inputs move behind all other actuators, as actuators can only be added there.

    Returns:
        Name of the controller of each actuator that was added, by its name.
    """
    added = {}
    for actuator in list(spec.actuators):
        first, *further = signature_inputs(actuator.gaintype, actuator.ctrlspec) or ("",)
        if actuator.gaintype == _GAIN.mjGAIN_DCMOTOR and actuator.ctrlspec == _NONE:
            actuator.ctrlspec, actuator.ctrllimited = _VOLTAGE, mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.ctrlrange = [0.0, NO_VOLTAGE]
        if first and further:
            servo = _moved_to_end(spec, actuator)
            for token in further:
                place = spec.add_actuator(name=f"{servo.name}.{token}")
                place.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=_NONE)
                for field in _TRANSMISSION:
                    setattr(place, field, getattr(servo, field))
                added[place.name] = servo.name
    return added


def _moved_to_end(spec: Any, actuator: Any) -> Any:
    """A copy of an actuator behind all others, which replaces it; sensors refer to it by name."""
    copied, name = spec.add_actuator(), actuator.name
    for field in dir(actuator):
        if not field.startswith(("_", "set_to")) and field not in _NOT_COPIED:
            setattr(copied, field, getattr(actuator, field))
    spec.delete(actuator)
    copied.name = name
    return copied


def further_inputs(model: Any) -> BoolArray:
    """Which actuators of a compiled model are further inputs of a controller, (nactuator,)."""
    further: BoolArray = model.actuator_ctrlnum == 0
    return further


def controller_of(model: Any, actuator: int) -> int:
    """Id of the controller that an actuator is an input of; its own for all but further inputs."""
    while model.actuator_ctrlnum[actuator] == 0:
        actuator -= 1
    return actuator


def input_of(model: Any, actuator: int) -> str:
    """Input that an actuator of a compiled model is the control of; empty if it is of no controller."""
    controller = controller_of(model, actuator)
    inputs = signature_inputs(model.actuator_gaintype[controller], model.actuator_ctrlspec[controller])
    return inputs[actuator - controller] if inputs else ""


@dataclass(frozen=True)
class SetpointLaw:
    """How the force p of a servo follows from a setpoint u: p = (gain + gain_by_length l) u + b0 + b1 l + b2 l'.

    Attributes:
        gain: Force per setpoint.
        gain_by_length: The same per length l of the transmission.
        bias: Coefficients b0, b1 and b2.
        by_rate: Whether the servo holds a rate and no length.
    """

    gain: float
    gain_by_length: float
    bias: tuple[float, float, float]
    by_rate: bool

    def force_free(self, length: float, rate: float = 0.0) -> float:
        """Setpoint without force at a length and its rate, but for integrals and friction; 0 where there is no gain."""
        b0, b1, b2 = self.bias
        gain = self.gain + self.gain_by_length * length
        return -(b0 + b1 * length + b2 * rate) / gain if gain else 0.0


def setpoint_law(model: Any, actuator: int) -> SetpointLaw | None:
    """Law of a servo of a compiled model, or the part that one input of a controller has in it; None: it is no such one."""
    if token := input_of(model, actuator):
        return _input_law(model, controller_of(model, actuator), token)
    affine = {_GAIN.mjGAIN_FIXED: 0.0, _GAIN.mjGAIN_AFFINE: float(model.actuator_gainprm[actuator, 1])}
    gain, by_length = float(model.actuator_gainprm[actuator, 0]), affine.get(_GAIN(int(model.actuator_gaintype[actuator])))
    if by_length is None or (gain == 0.0 and by_length == 0.0):
        return None
    is_affine = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
    b0, b1, b2 = model.actuator_biasprm[actuator, :3].tolist() if is_affine else (0.0, 0.0, 0.0)
    return SetpointLaw(gain, by_length, (b0, b1, b2), by_rate=b1 == 0.0 and b2 != 0.0)


def _input_law(model: Any, controller: int, token: str) -> SetpointLaw | None:
    """Law of an input of a controller: its first setpoint answers for the feedback, a rate beside a position for damping."""
    kind = _GAIN(int(model.actuator_gaintype[controller]))
    inputs = signature_inputs(kind, model.actuator_ctrlspec[controller])
    if kind == _GAIN.mjGAIN_PID:
        kp, kv = (-model.actuator_biasprm[controller, 1:3]).tolist()
    else:
        kp, kv = model.actuator_gainprm[controller, [4, 6]].tolist()
    if inputs[0] == "voltage":
        return None
    if token == "vel" and token != inputs[0]:
        return SetpointLaw(1.0, 0.0, (0.0, 0.0, -1.0), by_rate=False)
    if token != inputs[0]:
        return SetpointLaw(1.0, 0.0, (0.0, 0.0, 0.0), by_rate=False)
    if token == "pos":
        lag = 0.0 if "vel" in inputs or kp == 0.0 else kv / kp
        return SetpointLaw(1.0, 0.0, (0.0, -1.0, -lag), by_rate=False)
    gain = kv if token == "vel" else 1.0
    return SetpointLaw(gain, 0.0, (0.0, -kp, -kv), by_rate=kp == 0.0 and kv != 0.0) if gain else None
