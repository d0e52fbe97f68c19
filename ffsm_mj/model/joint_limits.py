"""Limits in a model file that cannot be stops: refused with file and line before the scene is compiled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import mujoco

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.places import Places

IGNORE = "or write 'limits: ignore' in the scenario"
LEAST_RANGE = 1e-6
"""Least extent of a range in the units of its file: both ends must be further apart than the tolerance of a closed gap."""
_BALL = mujoco.mjtJoint.mjJNT_BALL
_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def is_limited(element: Any) -> bool:
    """Whether a joint or tendon of a specification has limits, or a range that MuJoCo would take for none."""
    limited = mujoco.mjtLimited(element.limited)
    return limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        limited == mujoco.mjtLimited.mjLIMITED_AUTO and bool(element.range.any())
    )


def empty_ranges(spec: Any, name: str, files: ModelFiles) -> list[str]:
    """Faults of hinges and slides whose range is a single value or empty.

    MuJoCo refuses such a range or, without ``limited``, treats the joint as unlimited.

    Args:
        spec: Specification of one model; all its elements have names.
        name: Name of the model in the scene.
        files: Its files.
    """
    places, faults = Places(spec, {name: files}), []
    for joint in spec.joints:
        if joint.type in _ONE_AXIS and is_limited(joint) and not joint.range[1] - joint.range[0] > LEAST_RANGE:
            low, high = joint.range.tolist()
            what = "is empty: the lower value comes first" if low > high else "allows a single value: use a fixed joint"
            faults.append(f"{places.of('joint', f'{name}/{joint.name}')}: the range {low:g} {high:g} {what}")
    return faults


def unsupported_limits(scene: Any, files: Mapping[str, ModelFiles]) -> Iterator[str]:
    """Faults of limits that are no stops of a hinge or slide within a model.

    Args:
        scene: Specification of the scene with all models attached.
        files: Files of each model by its name.
    """
    places = Places(scene, files)
    for joint in scene.joints:
        if not is_limited(joint):
            continue
        if joint.type == _BALL:
            what = "limits of a ball joint are not supported; remove its range"
        elif joint.type in _ONE_AXIS and joint.parent.parent.name == "world":
            what = "limits of a joint to the world are not supported, as they would be external forces; remove its range"
        else:
            continue
        yield f"{places.of('joint', joint.name)}: {what}, {IGNORE}"
