"""``ffsm analyze`` sees mistakes of the engine that made the run, also where it makes them itself."""

from __future__ import annotations

import compileall
from pathlib import Path
from shutil import copytree

import pytest

from tests.mutants.mutant import ROOT, Mutant, copy_product, failing_checks, link, mutants, passes

PAGE = ROOT / "docs" / "checks.md"
MUTANTS = mutants()


@pytest.fixture(scope="session")
def product(tmp_path_factory):
    """A copy of the product with its bytecode."""
    folder = copy_product(tmp_path_factory.mktemp("product"))
    compileall.compile_dir(folder, quiet=1)
    return folder


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("mutant", MUTANTS, ids=[each.name for each in MUTANTS])
def test_a_mistake_is_seen(mutant: Mutant, product: Path, tmp_path: Path):
    """Or the page says why no check sees it, and then none does."""
    copy = copytree(product, tmp_path / "product", copy_function=link)
    mutant.apply(copy)
    if mutant.test:
        assert not passes(copy, mutant.test, tmp_path / "run")
        return
    code, failing = failing_checks(copy, mutant.scene, tmp_path / "run")
    if mutant.cannot or mutant.ends_with:
        assert (code, failing) == (mutant.ends_with, set())
    else:
        assert code == 1
        assert set(mutant.caught_by) <= failing


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("scene", sorted({each.scene for each in MUTANTS if each.scene}))
def test_without_mistakes_every_check_passes(scene, product, tmp_path):
    assert failing_checks(product, scene, tmp_path / "run") == (0, set())


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("test", sorted({each.test for each in MUTANTS if each.test}))
def test_without_mistakes_every_test_passes(test, product, tmp_path):
    assert passes(product, test, tmp_path / "run")


@pytest.mark.parametrize("mutant", MUTANTS, ids=[each.name for each in MUTANTS])
def test_a_patch_applies(mutant):
    for edit in mutant.patch:
        assert edit.changed(text := (ROOT / edit.file).read_text()) != text


def test_the_page_has_every_mutant():
    page = PAGE.read_text()
    table = "\n".join(f"| {each.wrong} | {each.seen_by} |" for each in MUTANTS)
    assert table in page, f"{PAGE.name} needs these rows:\n{table}"
