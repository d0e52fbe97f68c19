"""Specification of the scene to which the models are attached: its options and its compilation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.conservative import AUTHORED_MAGNETIC, authored_integrator
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.fixed import weightless
from ffsm_mj.model.number_faults import number_faults
from ffsm_mj.model.overrides import override
from ffsm_mj.model.places import Places
from ffsm_mj.model.source import REFUSALS, load_spec, own_words

# With MuJoCo's default of 1e-6, distances of cylinders and ellipsoids are wrong by 7e-7 m, and normals flip near contact.
_CCD_TOLERANCE = 1e-12
_CCD_ITERATIONS = 200

_OPTIONS = tuple(name for name in dir(mujoco.MjSpec().option) if not name.startswith("_"))
_SIZES = ("memory", "nconmax", "njmax", "nemax", "nstack", "nuserdata")


def empty_scene(time_step_s: float) -> Any:
    """An empty scene: no gravity, contacts without force, RK4 with a step of ``time_step_s``."""
    scene = mujoco.MjSpec()
    scene.modelname = "ffsm-mj scene"
    scene.option.gravity = [0.0, 0.0, 0.0]
    scene.option.timestep = time_step_s
    scene.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    scene.option.ccd_tolerance = _CCD_TOLERANCE
    scene.option.ccd_iterations = _CCD_ITERATIONS
    # Contact models replace MuJoCo's contact forces and its joint limits, which are soft springs; an automatic reset would
    # hide that a run diverges.
    # Sensors are evaluated at their own times.
    for flag in ("CONTACT", "LIMIT", "AUTORESET", "SENSOR"):
        scene.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return scene


def compile_scene(scene: Any, files: Mapping[str, ModelFiles], vfs: Any) -> Any:
    """Compile the scene, and refuse values that MuJoCo accepts but a simulation cannot use."""
    try:
        model = compile_spec(scene, vfs)
    except REFUSALS as error:
        _refuse_overrides(files, vfs)
        raise InputError(own_words(files.values(), vfs, error)) from error
    weightless(model, files)
    places = Places(scene, files)
    faults = [f"{places.of(kind, name)} {what}" for kind, name, what in number_faults(model)]
    if faults:
        raise InputError(faults)
    return model


def _refuse_overrides(files: Mapping[str, ModelFiles], vfs: Any) -> None:
    """Refuse changed properties with which a model no longer compiles.

    Raises:
        ScenarioFaults: There is such a model.
    """
    for name, each in files.items():
        if each.overrides:
            spec = load_spec(each, vfs)
            override(spec, name, each, vfs)
            try:
                compile_spec(spec, vfs)
            except REFUSALS as error:
                text = " ".join(str(error).split())
                fault = Fault(f"MuJoCo refuses the model with these properties: {text}", (each.overrides[-1].key, name))
                raise ScenarioFaults([fault]) from error


def take_options(scene: Any, spec: Any, gravity: tuple[float, ...], *, conservative: bool) -> None:
    """Make the options of scene and model equal before attaching: those of the scene, or of a dissipative model.

    Args:
        scene: The scene.
        spec: The model.
        gravity: Gravity of the model, m/s^2.
        conservative: Whether the scenario must be conservative.
    """
    if spec.authored.option & AUTHORED_MAGNETIC:
        scene.option.magnetic = spec.option.magnetic
    if not conservative:
        if any(gravity):
            scene.option.gravity = gravity
        for name in ("wind", "density", "viscosity"):
            if np.any(getattr(spec.option, name)):
                setattr(scene.option, name, getattr(spec.option, name))
        if authored_integrator(spec) is not None:
            scene.option.integrator = spec.option.integrator
    for name in _OPTIONS:
        setattr(spec.option, name, getattr(scene.option, name))
    for name in _SIZES:
        setattr(spec, name, getattr(scene, name))
