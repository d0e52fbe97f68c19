"""The notebooks of ``docs/notebooks``: each runs, and prints and shows what is stored in it."""

from __future__ import annotations

import base64
import io
import re
import runpy
from pathlib import Path

import nbformat
import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parent.parent
SCRIPT = runpy.run_path(str(ROOT / "docs" / "run_notebooks.py"))
NOTEBOOKS = SCRIPT["NOTEBOOKS"]
ROUNDING = re.compile(r"\d(\.\d+)?e[-+]\d\d|(?<=at most )0\b")
"""Residuals, which are rounding errors, or none."""
SCREEN = 45
"""Lines of code and text of a notebook at most: with a picture that is about one screen."""


def pictures(cell):
    """Pictures that a cell shows, alone or in a page of its own."""
    shown = [output.data for output in cell.outputs if output.output_type == "display_data"]
    texts = [data["image/png"] for data in shown if "image/png" in data]
    texts += [text for data in shown for text in re.findall(r'data:image/png;base64,([^"]+)', data.get("text/html", ""))]
    return [Image.open(io.BytesIO(base64.b64decode(text))) for text in texts]


def code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


@pytest.fixture(scope="module", params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request):
    return request.param


def test_it_prints_and_shows_what_is_stored(path, tmp_path, monkeypatch):
    """``make notebooks`` stores it; digits at the level of rounding may differ, and no sheet is empty."""
    for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):  # nothing of it in the home of whoever runs the suite
        monkeypatch.setenv(variable, str(tmp_path / variable))
    stored = nbformat.read(path, as_version=4)
    executed = SCRIPT["executed"](path, tmp_path)
    warned = [output.text for cell in code(executed) for output in cell.outputs if output.get("name") == "stderr"]
    assert all("ScenarioNote" in text for text in warned)  # what ``ffsm check`` says of a scenario, too
    made = SCRIPT["stored"](executed)
    for was, now in zip(code(stored), code(made), strict=True):
        texts = [ROUNDING.sub("#", SCRIPT["printed"](cell)) for cell in (was, now)]
        assert texts[0] == texts[1]
        assert [picture.size for picture in pictures(was)] == [picture.size for picture in pictures(now)]
        assert all(np.asarray(picture.convert("L")).std() > 5 for picture in pictures(now))
    assert any(pictures(cell) for cell in code(made))


def test_it_is_one_screen_and_has_nothing_of_the_machine(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert sum(len(cell.source.splitlines()) for cell in notebook.cells) <= SCREEN
    assert notebook.metadata == SCRIPT["_METADATA"]
    assert all(not cell.metadata and cell.get("execution_count") is None for cell in notebook.cells)
    assert not re.search(r"/(home|root|tmp|Users)\b", path.read_text(encoding="utf-8"))


def test_links_lead_somewhere(path):
    notebook = nbformat.read(path, as_version=4)
    targets = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", "".join(cell.source for cell in notebook.cells))
    assert targets
    for target in targets:
        assert (path.parent / target).is_file(), target


def test_there_are_five():
    assert [path.stem for path in NOTEBOOKS] == ["campaign", "capture", "impact", "own-arm", "own-law"]
