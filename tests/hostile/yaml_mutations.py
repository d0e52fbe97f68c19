"""Mutations of scenario files: of the tree, then of the bytes."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Any

from tests.hostile.documents import Map, Raw, get, places, put
from tests.hostile.values import DEEP, KEYS, SCALARS, STRUCTURES, TAGGED, TAGS, YAML_NUMBERS


def value(rng: Random) -> str:
    """YAML text of a value that hardly fits anywhere."""
    kind = rng.random()
    if kind < 0.35:
        return rng.choice(YAML_NUMBERS)
    if kind < 0.55:
        return rng.choice(SCALARS)
    if kind < 0.75:
        return f"{rng.choice(TAGS)} {rng.choice(TAGGED)}"
    if kind < 0.99:
        return rng.choice(STRUCTURES)
    return rng.choice(DEEP)


def mutate_tree(rng: Random, tree: Map) -> None:
    """One to four mutations in place."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        rng.choice(_TREE)(rng, tree)


def mutate_within(rng: Random, tree: Map, sections: tuple[str, ...], words: tuple[str, ...], keys: tuple[str, ...]) -> None:
    """One mutation of what some sections of a scenario say, by words and keys that could stand there."""
    found = [place for name in sections if name in dict(tree.pairs) for place in places(dict(tree.pairs)[name])]
    if not found:
        return
    place = rng.choice(found)
    container, i = place
    kind = rng.randrange(5)
    if kind == 0:
        del (container.pairs if isinstance(container, Map) else container)[i : i + 1]
    elif kind == 1:
        put(place, rng.choice(words))
    elif kind == 2:
        put(place, deepcopy(get(rng.choice(found))))
    elif kind == 3 and isinstance(container, Map):
        container.pairs[i] = (rng.choice(keys), container.pairs[i][1])
    elif kind == 3:
        container.insert(i, rng.choice(words))
    else:
        put(place, Raw(value(rng)))


def _place(rng: Random, tree: Map) -> Any:
    return rng.choice(list(places(tree)) or [(tree, 0)])


def _remove(rng: Random, tree: Map) -> None:
    container, i = _place(rng, tree)
    del (container.pairs if isinstance(container, Map) else container)[i : i + 1]


def _twice(rng: Random, tree: Map) -> None:
    container, i = _place(rng, tree)
    items = container.pairs if isinstance(container, Map) else container
    items[i:i] = deepcopy(items[i : i + 1])


def _rename(rng: Random, tree: Map) -> None:
    maps = [(c, i) for c, i in places(tree) if isinstance(c, Map)]
    if maps:
        container, i = rng.choice(maps)
        name, item = container.pairs[i]
        typo = name[:-1] or "x"
        others = [key for c, k in maps for key in (c.pairs[k][0],)]
        container.pairs[i] = (rng.choice((rng.choice(KEYS), typo, rng.choice(others))), item)


def _replace(rng: Random, tree: Map) -> None:
    if tree.pairs:
        put(_place(rng, tree), Raw(value(rng)))


def _other_node(rng: Random, tree: Map) -> None:
    if tree.pairs:
        put(_place(rng, tree), deepcopy(get(_place(rng, tree))))


def _nest(rng: Random, tree: Map) -> None:
    if tree.pairs:
        place = _place(rng, tree)
        inner = get(place)
        put(place, rng.choice(([inner], [[inner]], Map([("a", inner)]), [inner] * 3)))


def _insert(rng: Random, tree: Map) -> None:
    container, i = _place(rng, tree)
    item = Raw(value(rng))
    if isinstance(container, Map):
        container.pairs.insert(i, (rng.choice(KEYS), item))
    else:
        container.insert(i, item)


def _null(rng: Random, tree: Map) -> None:
    if tree.pairs:
        put(_place(rng, tree), None)


def _number(rng: Random, tree: Map) -> None:
    numbers = [p for p in places(tree) if isinstance(get(p), int | float)]
    if numbers:
        put(rng.choice(numbers), Raw(rng.choice(YAML_NUMBERS)))


def scale_numbers(rng: Random, tree: Map) -> None:
    """Numbers that stay numbers, some powers of ten away or with the other sign: most such scenarios are taken, and run."""
    numbers = [p for p in places(tree) if isinstance(get(p), int | float) and not isinstance(get(p), bool)]
    for place in rng.sample(numbers, min(len(numbers), rng.choice((1, 1, 2, 4)))):
        put(place, float(get(place)) * rng.choice((-1.0, 1.0, 1.0, 1.0)) * 10.0 ** rng.randint(-12, 12))


def _name(rng: Random, tree: Map) -> None:
    """Exchange two texts of the document: names that exist, in wrong places."""
    texts = [p for p in places(tree) if isinstance(get(p), str)]
    if texts:
        put(rng.choice(texts), get(rng.choice(texts)))


_TREE: tuple[Callable[[Random, Map], None], ...] = (
    *(_remove, _twice, _rename, _replace, _replace, _replace, _other_node, _nest, _insert, _null, _number, _number),
    _name,
)


def mutate_bytes(rng: Random, data: bytes) -> bytes:
    """Damage a file without regard to what it holds: flips, cuts, copies, byte order marks, other encodings, NULs."""
    return rng.choice(_BYTES)(rng, data)


def _at(rng: Random, data: bytes) -> int:
    return rng.randrange(max(1, len(data)))


def _flip(rng: Random, data: bytes) -> bytes:
    flipped = bytearray(data)
    for _ in range(rng.choice((1, 3, 20)) if data else 0):
        flipped[_at(rng, data)] ^= 1 << rng.randrange(8)
    return bytes(flipped)


def _cut(rng: Random, data: bytes) -> bytes:
    return data[: _at(rng, data)]


def _noise(rng: Random, data: bytes) -> bytes:
    at = _at(rng, data)
    return data[:at] + bytes(rng.randrange(256) for _ in range(rng.choice((1, 4, 50)))) + data[at:]


def _mark(rng: Random, data: bytes) -> bytes:
    return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf\xef\xbb\xbf")) + data


def _encoding(rng: Random, data: bytes) -> bytes:
    return data.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-16-le", "utf-32", "utf-7", "cp037")), "replace")


def _bad_character(rng: Random, data: bytes) -> bytes:
    at = _at(rng, data)
    return (
        data[:at]
        + rng.choice((b"\0", b"\0" * 100, b"\x85", b"\r", b"\t", b"\xff", b"\xc3\x28", b"\xed\xa0\x80"))
        + data[at:]
    )


def _line_ends(rng: Random, data: bytes) -> bytes:
    return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\n ", b"", b"\xe2\x80\xa8")))


def _splice(rng: Random, data: bytes) -> bytes:
    return data[: _at(rng, data)] + data[_at(rng, data) :]


def _wrap(rng: Random, data: bytes) -> bytes:
    before, after = rng.choice(
        ((b"%YAML 9.9\n---\n", b""), (b"%TAG ! x\n---\n", b""), (data, b"\n---\n"), (b"---\n", b"\n...\n"))
    )
    return rng.choice((b"", b"\n", b"\0", before + data + after))


_BYTES: tuple[Callable[[Random, bytes], bytes], ...] = (
    _flip,
    _cut,
    _noise,
    _mark,
    _encoding,
    _bad_character,
    _line_ends,
    _splice,
    _wrap,
)
