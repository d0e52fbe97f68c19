"""Where an element of a scene is written, and what it is called there: MuJoCo tells a line at most, and never the file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import mujoco

from ffsm_mj.model.files import ModelFiles
from ffsm_mj.model.xml import Element, elements

_TAGS = {
    "body": ("body", "link"),
    "joint": ("joint", "freejoint"),
    "equality": ("connect", "weld", "joint", "tendon", "flex", "flexvert", "flexstrain"),
}
_ENDS = ("body1", "body2", "joint1", "joint2", "tendon1", "tendon2", "site1", "site2", "flex")
_NO_BODIES = {"default", "equality", "tendon", "actuator", "sensor", "keyframe"}


class Places:
    """Of the elements of one scene; its files are read when the first one is asked for."""

    def __init__(self, scene: Any, files: Mapping[str, ModelFiles]) -> None:
        """Nothing is read yet.

        Args:
            scene: Specification of the scene.
            files: Files of each model by its prefix in the scene.
        """
        self._scene, self._files = scene, files
        self._elements: dict[str, list[Element]] = {}

    def of(self, kind: str, name: str) -> str:
        """``file:line: kind 'name'`` of an element by its name in the scene, for the beginning of a message.

        A constraint or tendon that the file gives no name is told by what it binds.
        """
        prefix, _, short = name.partition("/")
        if prefix not in self._files:
            return f"{' and '.join(model.place for model in self._files.values())}: {kind} {short!r}"
        element, file = getattr(self._scene, kind)(name), self._files[prefix].place
        line = re.search(r"line ([1-9]\d*)", (element.info if element is not None else "") or "")
        binds = _bound(element, kind)
        written = list(_written(self._all(prefix), _tags(element, kind), kind, short, binds))
        there = [each for each in written if not line or each.place.endswith(f":{line[1]}")]
        # What a shorthand of MJCF makes stands nowhere.
        place = " or ".join(dict.fromkeys(each.place for each in there)) or (f"{file}:{line[1]}" if line else file)
        named = not binds or any(each.attributes.get("name") for each in there)
        return f"{place}: {kind} {short!r}" if named else f"{place}: {_told(element, kind, binds)}"

    def _all(self, prefix: str) -> list[Element]:
        if prefix not in self._elements:
            model = self._files[prefix]
            documents = {name: xml for name, xml in model.files.items() if name.lower().endswith((".xml", ".urdf"))}
            self._elements[prefix] = [each for name, xml in documents.items() for each in elements(xml, model.label + name)]
        return self._elements[prefix]


def _written(every: list[Element], tags: tuple[str, ...], kind: str, name: str, binds: tuple[str, ...]) -> Iterator[Element]:
    """Elements that can be the one of a name: of that name, or else of none."""
    prefixes = [element.attributes["prefix"] for element in every if element.attributes.get("prefix")]
    before = re.compile(f"(?:{'|'.join(map(re.escape, prefixes))})*")

    def calls(given: str, full: str) -> bool:
        return full.endswith(given) and before.fullmatch(full.removesuffix(given)) is not None

    def is_called(element: Element) -> bool:
        own = element.attributes.get("name", "")
        numberless = name[: name.rfind(own) + len(own)] if element.copies > 1.0 else name  # <replicate> numbers its copies
        return bool(own) and calls(own, numberless)

    possible = [element for element in every if element.tag in tags and _is(element, kind)]
    named = [each for each in possible if is_called(each)]
    for each in named or [each for each in possible if not each.attributes.get("name")]:
        ends = [each.attributes[end] for end in _ENDS if each.attributes.get(end)] if kind == "equality" else []
        if all(any(calls(end, bound) for bound in binds) for end in ends):
            yield each


def _tags(element: Any, kind: str) -> tuple[str, ...]:
    if kind != "tendon" or element is None:
        return _TAGS.get(kind, (kind,))
    of_joints = any(wrap.type == mujoco.mjtWrap.mjWRAP_JOINT for wrap in element.path)
    return ("fixed",) if of_joints else ("spatial",)


def _is(element: Element, kind: str) -> bool:
    """Whether an element of such a tag, which may mean several things, is of a kind."""
    binding = any(end in element.attributes for end in _ENDS)
    return binding if kind == "equality" else kind == "tendon" or not (binding or _NO_BODIES & set(element.parents))


def _bound(element: Any, kind: str) -> tuple[str, ...]:
    """Names of what a constraint or a tendon binds, as its model has them; nothing of other elements."""
    if element is None or kind not in ("equality", "tendon"):
        return ()
    if kind == "equality":
        names = [element.name1, element.name2]
    else:
        names = [wrap.target.name for wrap in element.path if wrap.target is not None]
    return tuple(dict.fromkeys(name.partition("/")[2] or name for name in names if name))


def _told(element: Any, kind: str, binds: tuple[str, ...]) -> str:
    names = " and ".join(map(repr, binds))
    if kind == "tendon":
        return f"tendon of {names}"
    return f"equality {mujoco.mjtEq(element.type).name.removeprefix('mjEQ_').lower()} of {names}"
