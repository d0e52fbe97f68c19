"""Which geoms the sides of a contact rule name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ffsm_mj.model.system import System


class GeomSides:
    """Names of the sides of contact rules that stand for each geom."""

    def __init__(self, system: System) -> None:
        """Index the geoms of a system."""
        self._system, model = system, system.mj
        names = [model.geom(i).name for i in range(model.ngeom)]
        short = Counter(name.partition("/")[2] for name in names)
        self._geoms = {name: name for name in names}
        self._geoms |= {
            bare: name for name in names if short[bare := name.partition("/")[2]] == 1 and bare not in self._geoms
        }
        self._models = {part.name for part in system.models}

    def names(self, between: Sequence[str], geoms: Sequence[str]) -> bool:
        """Whether two sides name two geoms, in one order or the other."""
        first, second = between
        a, b = geoms
        return self._pair(first, second, a, b) or self._pair(first, second, b, a)

    def _pair(self, first: str, second: str, a: str, b: str) -> bool:
        one, other = (name.partition("/")[0] for name in (a, b))
        if "*" in (first, second) and one == other:
            return False
        if "self" in (first, second):
            return one == other and self._has(second if first == "self" else first, b if first == "self" else a)
        return self._has(first, a) and self._has(second, b)

    def _has(self, side: str, geom: str) -> bool:
        """Whether a side has a geom: all, a model, a subtree, a geom or a body, in this order."""
        if side == "*" or side in self._models:
            return side in ("*", geom.partition("/")[0])
        if not side.endswith("/*") and side in self._geoms:
            return bool(self._geoms[side] == geom)
        model = self._system.mj
        try:
            body = self._system.index("body", side.removesuffix("/*"))
        except LookupError:
            return False
        at = int(model.geom(geom).bodyid[0])
        while side.endswith("/*") and at not in (0, body):
            at = int(model.body_parentid[at])
        return at == body
