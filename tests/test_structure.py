"""What imports what: the layers of ``pyproject.toml`` hold in the compiled core too, no circles, nothing imported by name.

import-linter reads ``.py`` files. Here ``.pyx`` and ``.pxd`` count as well, and the stubs. A module of the core is in
the layer of the package that it is compiled for, so that it may call this package back.
"""

from __future__ import annotations

import ast
import re
import tomllib
import traceback
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

from ffsm_mj.arrays import FloatArray
from ffsm_mj.cli.main import main
from ffsm_mj.log.mcap.sink import McapSink

ROOT = Path(__file__).parent.parent
PACKAGES = (ROOT / "ffsm_mj", ROOT / "controllers" / "ffsm_controllers")
CORE = "ffsm_mj._core."
HOME = {
    **dict.fromkeys(("loops", "steppers", "travel"), "dynamics"),
    "features": "contact",
    **dict.fromkeys(
        ("contacts", "forces", "mechanisms", "row_evaluator", "rows", "slip_layers", "stages", "steady"), "contact_models"
    ),
    "free_ticks": "simulation",
    "logged_law": "replay",
}
"""Rooms of the modules of the core that import more than what is below the core."""
BY_NAME = {"ffsm_mj/__init__.py"}
"""Files that import modules of ffsm_mj by name: the table of public names alone."""
OTHERS_BY_NAME = {
    "ffsm_mj/gym/rendering.py": "MuJoCo's modules for OpenGL, by environment variable",
}
"""Files that import a module by a name that is computed, and which."""
_CYTHON = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+c?import[ \t]+(\([^)]*\)|[^\n#]+)|c?import[ \t]+([\w., ]+))", re.MULTILINE
)
_LOADERS = {"import_module", "__import__", "resolve_name", "run_module"}


def sources(*suffixes: str) -> Iterator[Path]:
    """Files of the product; those of ``templates/my_law`` are the start of a package of its own."""
    paths = (path for package in PACKAGES for path in sorted(package.rglob("*")))
    return (path for path in paths if path.suffix in suffixes and "my_law" not in path.parts)


def module_of(path: Path) -> str:
    base = next(package for package in PACKAGES if path.is_relative_to(package))
    return ".".join(path.relative_to(base.parent).with_suffix("").parts).removesuffix(".__init__")


def imported(path: Path) -> Iterator[tuple[str, bool]]:
    """Dotted names that a file imports, wherever in it, and whether for annotations alone."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".pyx", ".pxd"):
        for module, names, modules in _CYTHON.findall(text):
            prefix = f"{module}." if module else ""
            yield from (
                (prefix + name.split()[0], False) for name in (names or modules).strip("()\n ").split(",") if name.strip()
            )
        return
    tree = ast.parse(text)
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)]
    typed = {id(node) for block in blocks for part in block.body for node in ast.walk(part)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, f"{path}: a relative import"
            yield from ((f"{node.module}.{each.name}", path.suffix == ".pyi" or id(node) in typed) for each in node.names)
        elif isinstance(node, ast.Import):
            yield from ((each.name, path.suffix == ".pyi" or id(node) in typed) for each in node.names)


@cache
def imports() -> Mapping[tuple[str, str], bool]:
    """Pairs of modules of which the first imports the second, and whether for annotations alone."""
    paths = [*sources(".py", ".pyi", ".pyx", ".pxd")]
    modules, found = set(map(module_of, paths)), dict[tuple[str, str], bool]()
    for path in paths:
        for name, typed in imported(path):
            parts = name.split(".")
            target = next((module for k in range(len(parts), 0, -1) if (module := ".".join(parts[:k])) in modules), "")
            pair = module_of(path), target
            if target and pair[0] != target:
                found[pair] = found.get(pair, True) and typed
    return found


def package(module: str) -> str:
    """The package of ``ffsm_mj`` that a module is in; one of the core is in the package that it is compiled for."""
    if module.startswith(CORE):
        return HOME.get(module.removeprefix(CORE), "_core")
    first, _, rest = module.partition(".")
    return rest.partition(".")[0] if first == "ffsm_mj" else first


@cache
def heights() -> Mapping[str, float]:
    """Height of each package, from the layers of import-linter; control laws stand just above what they may see."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each["type"] == "layers")
    of_layers = {name.strip(): k for k, layer in enumerate(reversed(layers)) for name in layer.split("|")}
    return {**of_layers, "ffsm_controllers": of_layers["task_model"] + 0.5}


def circles(pairs: Iterable[tuple[str, str]]) -> list[set[str]]:
    """Sets of names each of which leads to all others of its set."""
    ahead: dict[str, set[str]] = {}
    for first, second in pairs:
        ahead.setdefault(first, set()).add(second)

    def reached(start: str) -> set[str]:
        seen, waiting = set[str](), [start]
        while waiting:
            new = ahead.get(waiting.pop(), set()) - seen
            seen |= new
            waiting += new
        return seen

    beyond = {name: reached(name) for name in ahead}
    found = {
        frozenset(other for other in beyond[name] if name in beyond.get(other, ())) for name in ahead if name in beyond[name]
    }
    return sorted(map(set, found), key=sorted)


def test_a_circle_is_found():
    pairs = [("a", "b"), ("b", "c"), ("c", "a"), ("c", "d"), ("e", "f"), ("f", "e"), ("d", "e")]
    assert circles(pairs) == [{"a", "b", "c"}, {"e", "f"}]


def test_imports_go_down_in_the_core_too():
    """Modules import their own package, and packages of lower layers."""
    pairs = (
        (first, second, package(first), package(second)) for first, second in imports() if "ffsm_mj" not in (first, second)
    )
    up = {(first, second) for first, second, a, b in pairs if a != b and not heights()[b] < heights()[a]}
    assert up == set()


def test_what_is_said_of_the_core_is_needed():
    """Modules of the core stand as low as they can: above the core itself only where they import what is there."""
    names = {module.removeprefix(CORE) for module in chain(*imports()) if module.startswith(CORE)}
    assert set(HOME) <= names
    users = {
        first.removeprefix(CORE)
        for first, second in imports()
        if first.startswith(CORE) and package(second) in HOME.values()
    }
    assert set(HOME) <= users


def test_no_circle_of_packages():
    packages = {(package(first), package(second)) for first, second in imports()}
    assert circles((a, b) for a, b in packages if a != b) == []


def test_no_circle_of_modules():
    """None at run time, imports inside functions included; none with annotations either, stubs of the core aside."""
    assert circles(pair for pair, typed in imports().items() if not typed) == []
    assert circles(pair for pair in imports() if not any(module.startswith(CORE) for module in pair)) == []


def loaded_by_name(path: Path) -> Iterator[str]:
    """Names that a file imports by a call; an f-string without its values, empty for one that is computed."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    called = {
        each.asname or each.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for each in node.names
        if each.name in _LOADERS
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in called | _LOADERS:
                given = [*node.args, *(keyword.value for keyword in node.keywords)][:1]
                texts = [each.value for part in given for each in ast.walk(part) if isinstance(each, ast.Constant)]
                yield "".join(text for text in texts if isinstance(text, str))


def test_no_module_of_ours_is_imported_by_name():
    """Neither import-linter nor a reader sees such an import."""
    ours, computed = set(), set()
    for path in sources(".py"):
        for name in loaded_by_name(path):
            place = path.relative_to(ROOT).as_posix()
            if name.startswith(("ffsm_mj", "ffsm_controllers", ".")):
                ours.add(place)
            elif not name:
                computed.add(place)
    assert ours | (computed - set(OTHERS_BY_NAME)) == BY_NAME
    assert set(OTHERS_BY_NAME) <= computed


@pytest.mark.parametrize(
    ("code", "name"),
    [
        ("import importlib\nimportlib.import_module('ffsm_mj.replay')", "ffsm_mj.replay"),
        ("from importlib import import_module as load\nload(f'ffsm_mj.cli.{name}')", "ffsm_mj.cli."),
        ("__import__('ffsm_mj' + '.replay')", "ffsm_mj.replay"),
        ("import importlib as i\ni.import_module(name='ffsm_mj.x')", "ffsm_mj.x"),
        ("import pkgutil\npkgutil.resolve_name('ffsm_mj.replay:explain')", "ffsm_mj.replay:explain"),
    ],
)
def test_an_import_by_name_is_found(tmp_path, code, name):
    (tmp_path / "a.py").write_text(code)
    assert [*loaded_by_name(tmp_path / "a.py")] == [name]


def test_the_way_of_a_run(tmp_path, monkeypatch):
    """From the command line to the log, as the page on the architecture lists it: 14 functions at most."""
    way: list[str] = []
    write = McapSink.rows

    def rows(sink: McapSink, block: FloatArray) -> None:
        if not way:
            frames = [(Path(each.filename), each.name) for each in traceback.extract_stack()[:-1]]
            home = ROOT / "ffsm_mj"
            way.extend(f"{file.relative_to(home).as_posix()}: {name}" for file, name in frames if file.is_relative_to(home))
        write(sink, block)

    monkeypatch.setattr(McapSink, "rows", rows)
    assert main(["run", "baseline", "--no-rerun", "-s", "duration_s=1", "--out", str(tmp_path / "run")]) == 0
    text = (
        (ROOT / "docs" / "architecture.md")
        .read_text()
        .partition("goes through these functions")[2]
        .partition("`ffsm campaign run")[0]
    )
    listed = [
        f"{file}: {function}"
        for file, functions in re.findall(r"^\d+\. `([^`]+)`: (.+)$", text, re.MULTILINE)
        for function in re.findall(r"`(\w+)`", functions)
    ]
    assert [*way, "log/mcap/sink.py: rows"] == listed
    assert len(listed) <= 14
