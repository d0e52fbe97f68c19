"""Docstrings of the attributes of classes, read from the source of their module when somebody asks for them."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from itertools import pairwise


def attribute_docstrings(cls: type) -> dict[str, str]:
    """Docstrings below the annotated attributes of a class and its bases, by name; none of a class without source."""
    docstrings: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        docstrings |= _of_module(base.__module__).get(base.__qualname__.replace("<locals>.", ""), {})
    return docstrings


@cache
def _of_module(name: str) -> dict[str, dict[str, str]]:
    """Docstrings by attribute, by the qualified name of the class without the marks of local ones."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[name]))
    except (KeyError, OSError, TypeError, SyntaxError):
        return {}
    return dict(_classes(tree, ""))


def _classes(node: ast.AST, prefix: str) -> Iterator[tuple[str, dict[str, str]]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef):
            yield prefix + child.name, dict(_attributes(child))
        yield from _classes(child, f"{prefix}{child.name}." if isinstance(child, ast.ClassDef | ast.FunctionDef) else prefix)


def _attributes(cls: ast.ClassDef) -> Iterator[tuple[str, str]]:
    for statement, below in pairwise(cls.body):
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and isinstance(below, ast.Expr):
            text = below.value
            if isinstance(text, ast.Constant) and isinstance(text.value, str):
                yield statement.target.id, inspect.cleandoc(text.value)
