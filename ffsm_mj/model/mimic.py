"""``<mimic>`` elements of URDFs, which MuJoCo compiles to unnamed equality constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.xml import elements, has_urdf_root


@dataclass(frozen=True)
class Mimic:
    """A ``<mimic>`` element.

    Attributes:
        joint: The joint that follows.
        leader: The joint that it follows.
        place: ``file:line``.
    """

    joint: str
    leader: str
    place: str

    def is_source_of(self, follower: str, leader: str) -> bool:
        """Whether a constraint between two joints can come from this element.

        Args:
            follower: Name in the model of the joint that follows: its name in the URDF after the prefixes of attachments.
            leader: Name in the model of the joint that it follows.
        """
        before = follower.removesuffix(self.joint)
        return (before + self.joint, before + self.leader) == (follower, leader)


def mimic_place(written: Iterable[Mimic], follower: str, leader: str) -> str:
    """Text ``file:line: joint 'a' mimics joint 'b'`` of a constraint that comes from a ``<mimic>``; empty if it does not.

    If several URDFs of a model have joints of these names, all their places are given.

    Args:
        written: All ``<mimic>`` elements of the model, longest names first.
        follower: Name of the joint that follows, in the model.
        leader: Name of the joint that it follows.
    """
    found = [each for each in written if each.is_source_of(follower, leader)]
    if not found:
        return ""
    place = " or ".join(dict.fromkeys(each.place for each in found if each.joint == found[0].joint))
    return f"{place}: <mimic> of joint {follower!r} by joint {leader!r}"


def mimics(files: ModelFiles) -> list[Mimic]:
    """All ``<mimic>`` elements of a model and its attached URDFs; longest names first, as names may share an ending."""
    urdfs = [name for name, content in files.files.items() if has_urdf_root(content)]
    found = [each for name in urdfs for each in _written(files.files[name], files.place_of(name))]
    return sorted(found, key=lambda each: -len(each.joint))


def _written(urdf: bytes, place: str) -> Iterator[Mimic]:
    joint = ""
    for element in elements(urdf, place):
        if element.tag == "joint":
            joint = element.attributes.get("name", "")
        elif element.tag == "mimic" and element.parents[-1] == "joint":
            yield Mimic(joint, element.attributes.get("joint", ""), element.place)
