"""``<mimic>`` in a URDF: which joint follows which. MuJoCo makes a soft constraint of it, which tells neither."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.xml import elements


@dataclass(frozen=True)
class Mimic:
    """A ``<mimic>`` as it is written.

    Attributes:
        joint: The joint that follows.
        leader: The joint that it follows.
        place: ``file:line``.
    """

    joint: str
    leader: str
    place: str

    def makes(self, follower: str, leader: str) -> bool:
        """Whether a constraint between two joints may be this one's.

        Args:
            follower: Name of the joint that follows, in the model: that of the URDF behind the prefixes of what attaches it.
            leader: Name of the joint that it follows, likewise.
        """
        before = follower.removesuffix(self.joint)
        return (before + self.joint, before + self.leader) == (follower, leader)


def mimic_fault(written: Iterable[Mimic], follower: str, leader: str) -> str:
    """What is to be said of a constraint between two joints; empty where no ``<mimic>`` makes it.

    Where several URDFs of a model have joints of these names, all places are told.

    Args:
        written: Each ``<mimic>`` of the model, longest names first.
        follower: Name of the joint that follows, in the model.
        leader: Name of the joint that it follows.
    """
    found = [each for each in written if each.makes(follower, leader)]
    if not found:
        return ""
    same = [each for each in found if each.joint == found[0].joint]
    place = " or ".join(dict.fromkeys(each.place for each in same))
    return (
        f"{place}: joint {follower!r} mimics joint {leader!r} (<mimic>), which MuJoCo makes a soft constraint: "
        f"take <mimic> out, or let 'strip: [equalities]' of the scenario, so that each moves by its own motor, "
        f'or write type="fixed" at joint {found[0].joint!r}'
    )


def mimics(files: ModelFiles) -> list[Mimic]:
    """Each ``<mimic>`` of a model, of the URDFs that it attaches too; longest names first, which could end in others."""
    urdfs = [name for name in files.files if name.lower().endswith(".urdf")]
    found = [each for name in urdfs for each in _written(files.files[name], files.label + name)]
    return sorted(found, key=lambda each: -len(each.joint))


def _written(urdf: bytes, place: str) -> Iterator[Mimic]:
    joint = ""
    for element in elements(urdf, place):
        if element.tag == "joint":
            joint = element.attributes.get("name", "")
        elif element.tag == "mimic" and element.parents[-1] == "joint":
            yield Mimic(joint, element.attributes.get("joint", ""), element.place)
