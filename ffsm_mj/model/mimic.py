"""``<mimic>`` in a URDF: which joint follows which. MuJoCo makes a soft constraint of it, which tells neither."""

from __future__ import annotations

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.xml import elements


def mimic_faults(files: ModelFiles) -> dict[str, str]:
    """What is to be said of each ``<mimic>`` of a model, by the name of the joint that follows; none of what is no URDF."""
    if not files.urdf:
        return {}
    faults, joint = {}, ""
    for element in elements(files.files[files.main], files.place):
        if element.tag == "joint":
            joint = element.attributes.get("name", "")
        elif element.tag == "mimic" and element.parents[-1] == "joint":
            leader = element.attributes.get("joint", "")
            faults[joint] = (
                f"{element.place}: joint {joint!r} mimics joint {leader!r} (<mimic>), which MuJoCo makes a soft constraint: "
                f"take <mimic> out, or let 'strip: [equalities]' of the scenario, so that each moves by its own motor, "
                f'or write type="fixed" at joint {joint!r}'
            )
    return faults
