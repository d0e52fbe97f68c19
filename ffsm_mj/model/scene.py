"""The specification of a scene: what models are attached to, whose options rule them all, and how it is compiled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.conservative import authored_integrator
from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.fixed import weightless
from ffsm_mj.model.number_faults import number_faults
from ffsm_mj.model.overrides import override
from ffsm_mj.model.places import Places
from ffsm_mj.model.source import REFUSALS, load_spec, own_words

# At MuJoCo's default of 1e-6 cylinders and ellipsoids miss their distance by 7e-7 m and flip normals near touch.
_CCD_TOLERANCE = 1e-12
_CCD_ITERATIONS = 200

_SHARED_OPTIONS = (
    *("gravity", "wind", "density", "viscosity", "integrator", "timestep"),
    *("ccd_tolerance", "ccd_iterations", "disableflags"),
)


def empty_scene(time_step_s: float) -> Any:
    """One with nothing in it: no gravity, contacts without force, integrated by RK4 in steps of this time, s."""
    scene = mujoco.MjSpec()
    scene.modelname = "ffsm-mj scene"
    scene.option.gravity = [0.0, 0.0, 0.0]
    scene.option.timestep = time_step_s
    scene.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    scene.option.ccd_tolerance = _CCD_TOLERANCE
    scene.option.ccd_iterations = _CCD_ITERATIONS
    # Contact is resolved by ffsm_mj.contact_models.impact, limits would be soft springs, and a reset would rewind a
    # diverging run.
    for flag in ("CONTACT", "LIMIT", "AUTORESET"):
        scene.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return scene


def compile_scene(scene: Any, files: Mapping[str, ModelFiles], vfs: Any) -> Any:
    """Compile the scene, and refuse numbers that MuJoCo takes though no run could work with them."""
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
    """Refuse changed properties with which a model does not compile, as it does without.

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
                fault = Fault(f"MuJoCo refuses what this makes of the model: {text}", (each.overrides[-1].key, name))
                raise ScenarioFaults([fault]) from error


def take_options(scene: Any, spec: Any, gravity: tuple[float, ...], *, conservative: bool) -> None:
    """Give parent and child equal options before attaching: the scene's, or the model's where dissipation is allowed.

    Args:
        scene: The scene.
        spec: The model.
        gravity: What the model asks for, m/s^2.
        conservative: Whether nothing may act on free motion.
    """
    if not conservative:
        if any(gravity):
            scene.option.gravity = gravity
        for name in ("wind", "density", "viscosity"):
            if np.any(getattr(spec.option, name)):
                setattr(scene.option, name, getattr(spec.option, name))
        if authored_integrator(spec) is not None:
            scene.option.integrator = spec.option.integrator
        scene.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    for name in _SHARED_OPTIONS:
        setattr(spec.option, name, getattr(scene.option, name))
