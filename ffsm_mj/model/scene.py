"""Specification of the scene to which the models are attached: its options and its compilation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.model.compilation import compile_spec
from ffsm_mj.model.conservative import FLUID, authored_options, gravity_of
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
_GEOM_CONTACT = ("condim", "friction", "gap", "margin", "priority", "solimp", "solmix", "solref")
_PAIR_CONTACT = ("condim", "friction", "gap", "margin", "solimp", "solref", "solreffriction")
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
    # Contact models replace MuJoCo's contact forces, its joint limits and its dry friction, which are soft, and rows its
    # equality constraints; an automatic reset would hide that a run diverges.
    # Sensors are evaluated at their own times.
    for flag in ("CONTACT", "LIMIT", "FRICTIONLOSS", "EQUALITY", "AUTORESET", "SENSOR"):
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
    """Make the options of scene and model equal before attaching: the scene's, with the surroundings that it may adopt.

    Args:
        scene: The scene.
        spec: The model.
        gravity: Gravity of the model, m/s^2.
        conservative: Whether the scenario must be conservative.
    """
    if "magnetic" in authored_options(spec):
        scene.option.magnetic = spec.option.magnetic
    if not conservative:
        if any(gravity):
            scene.option.gravity = gravity
        for name in FLUID:
            if np.any(getattr(spec.option, name)):
                setattr(scene.option, name, getattr(spec.option, name))
    for name in _OPTIONS:
        setattr(spec.option, name, getattr(scene.option, name))
    for name in _SIZES:
        setattr(spec, name, getattr(scene, name))


def left_out(scene: Any, spec: Any, files: ModelFiles, *, conservative: bool) -> Iterator[str]:
    """One note that lists what a model file says of the simulator and the surroundings and a scene leaves out, if anything.

    A conservative scene is a vacuum without gravity. Others adopt gravity and the medium of their models.

    Args:
        scene: Specification of the scene, with its own options.
        spec: Specification of the model, with the options of its file.
        files: Its files.
        conservative: Whether the scenario must be conservative.
    """
    adopted = {"magnetic", "gravity", *(() if conservative else FLUID)}
    options = [
        name
        for name in authored_options(spec)
        if name not in adopted and not np.array_equal(getattr(spec.option, name), getattr(scene.option, name))
    ]
    weight = gravity_of(spec, files) if conservative else ()
    compensated = conservative and any(body.gravcomp for body in spec.bodies)
    blank = mujoco.MjSpec()
    listed = [
        *([f"gravity {' '.join(f'{value:g}' for value in weight)}"] if any(weight) else ()),
        *(["gravcomp"] if compensated else ()),
        *options,
        *_given(spec.geoms, blank.worldbody.add_geom(), _GEOM_CONTACT, "geoms"),
        *_given(spec.pairs, blank.add_pair(), _PAIR_CONTACT, "pairs"),
    ]
    if listed:
        yield (
            f"{files.place}: left out, since the scenario has its own ('time_step_s', 'contacts', and 'conservative: false' "
            f"for gravity and fluids): {', '.join(listed)}"
        )


def _given(elements: Any, default: Any, names: Iterable[str], noun: str) -> Iterator[str]:
    """Attributes that differ from MuJoCo's defaults in some element, as a phrase; none if there are none."""

    def differs(each: Any, name: str) -> bool:  # a specification marks a number that its file does not give by NaN
        return not np.array_equal(getattr(each, name), getattr(default, name), equal_nan=True)

    if found := [name for name in names if any(differs(each, name) for each in elements)]:
        yield f"{', '.join(found)} of {noun}"
