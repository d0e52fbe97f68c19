"""Geoms that one side of a contact rule names."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ffsm_mj.errors import unknown_name
from ffsm_mj.model.system import System

ALL, SELF, SUBTREE = "*", "self", "/*"


@dataclass(frozen=True)
class GeomSelection:
    """The geoms of one side.

    Attributes:
        geoms: Mask over all geoms, (ngeom,).
        is_geom: Whether the side names a single geom.
        is_all: Whether it is ``"*"``.
    """

    geoms: npt.NDArray[np.bool_]
    is_geom: bool = False
    is_all: bool = False


class GeomSelector:
    """Resolves sides of contact rules.

    Attributes:
        part: Number of the model of each geom, in the order of the scenario; -1 for geoms of the world, (ngeom,).
    """

    def __init__(self, system: System) -> None:
        """Index the geoms of a system."""
        self._system, model = system, system.mj
        self._bodies = np.asarray(model.geom_bodyid)
        part_of_body = np.full(model.nbody, -1)
        for number, part in enumerate(system.models):
            part_of_body[list(part.bodies)] = number
        self.part = part_of_body[self._bodies]
        self._parts = {part.name: number for number, part in enumerate(system.models)}
        names = geom_names(system)
        self._geoms = {name: geom for some in (short_names(names), names) for geom, name in enumerate(some)}

    def side(self, name: str) -> GeomSelection:
        """Geoms of a side other than ``self``.

        Raises:
            LookupError: No model, body, subtree or geom has this name, or the name is ambiguous.
        """
        if name == ALL:
            return GeomSelection(self.part >= 0, is_all=True)
        if name in self._parts:
            return GeomSelection(self.part == self._parts[name])
        if name.endswith(SUBTREE):
            return GeomSelection(self._subtree(name))
        if name in self._geoms:
            chosen = np.zeros(len(self.part), dtype=bool)
            chosen[self._geoms[name]] = True
            return GeomSelection(chosen, is_geom=True)
        return GeomSelection(self._bodies == self._body(name, name))

    def same_parts(self, side: GeomSelection) -> GeomSelection:
        """All geoms of the models that the geoms of a side belong to."""
        return GeomSelection(np.isin(self.part, np.unique(self.part[side.geoms])) & (self.part >= 0))

    def _subtree(self, name: str) -> npt.NDArray[np.bool_]:
        model, body = self._system.mj, self._body(name.removesuffix(SUBTREE), name)
        inside = np.zeros(model.nbody, dtype=bool)
        inside[body] = True
        for each in range(body + 1, model.nbody):  # a parent precedes its children
            inside[each] |= inside[model.body_parentid[each]]
        return np.asarray(inside[self._bodies])

    def _body(self, body: str, name: str) -> int:
        system = self._system
        try:
            return system.index("body", body)
        except LookupError as error:
            if "ambiguous" in str(error):
                raise
            if name == body and sum(full.endswith(f"/{name}") for full in system.names("geom")) > 1:
                system.resolve("geom", name)  # raises: several models have this geom
            known = {*self._parts, *system.names("body"), *system.names("geom")}
            raise LookupError(unknown_name("model, body or geom", name, known)) from None


def geom_names(system: System) -> tuple[str, ...]:
    """Full names of all geoms by id."""
    return tuple(system.mj.geom(geom).name for geom in range(system.mj.ngeom))


def short_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names without the prefix of their model, where what remains is unique."""
    bare = [name.split("/", 1)[-1] for name in names]
    count = Counter(bare)
    return tuple(
        short if count[short] == 1 and short not in names else name for short, name in zip(bare, names, strict=True)
    )
