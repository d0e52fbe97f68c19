"""``docs/tour.ipynb`` as it stands: every cell runs and shows what its text promises; it is kept without outputs."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image

DOCS = Path(__file__).parent.parent / "docs"
TOUR = DOCS / "tour.ipynb"


@pytest.fixture(scope="module")
def kept():
    return nbformat.read(TOUR, as_version=4)


def executed(folder):
    """Code cells of the notebook by id, after all of them ran in a folder; a cell that raises ends the test here."""
    notebook = nbformat.read(TOUR, as_version=4)
    client = NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(folder)}})
    client.execute()
    return {cell.id: cell for cell in notebook.cells if cell.cell_type == "code"}


def printed(cell):
    return "".join(output.text for output in cell.outputs if output.output_type == "stream" and output.name == "stdout")


def shown(cell, kind):
    return [output.data[kind] for output in cell.outputs if kind in output.get("data", {})]


def pictures(html):
    found = re.findall(r'src="data:image/(?:png|gif);base64,([^"]+)"', html)
    return [Image.open(io.BytesIO(base64.b64decode(text))) for text in found]


def test_it_is_kept_without_outputs(kept):
    """So none can be stale; and nothing of the machine that it was written on is in it."""
    nbformat.validate(kept)
    for cell in kept.cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
        assert not cell.metadata
    assert set(kept.metadata) == {"kernelspec", "language_info"}
    assert kept.metadata.kernelspec == {"display_name": "Python 3", "language": "python", "name": "python3"}
    assert not re.search(r"/(home|root|tmp|Users)\b", TOUR.read_text())


def test_links_lead_somewhere(kept):
    for target in re.findall(r"\]\(([^)#]+)\)", "".join(cell.source for cell in kept.cells)):
        assert (DOCS / target).is_file(), target


@pytest.mark.slow
@pytest.mark.long
def test_every_cell_runs_and_shows_what_it_should(tmp_path, baseline, monkeypatch):
    """Nothing on stderr, no warning; figures are no empty sheets; the numbers are those of the run."""
    for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):  # nothing of it in the home of whoever runs the suite
        monkeypatch.setenv(variable, str(tmp_path / variable))
    cells = executed(tmp_path)
    for cell in cells.values():
        assert cell.outputs, cell.source
        assert not [output for output in cell.outputs if output.get("name") == "stderr" or output.output_type == "error"]
    (card,) = shown(cells["run"], "text/html")
    hit = baseline.impacts[0]
    assert "completed after 12 s" in card
    assert f"{hit.time_s:.6f} s: robot/gripper on object/box" in card
    assert printed(cells["hit"]).startswith(f"{hit.time_s:.6f} s, gap ")
    assert f"e = 1: {hit.impulse_N_s:.6f} N s\n" in printed(cells["hit"])
    checks = printed(cells["checks"]).splitlines()
    assert len(checks) == len(baseline.checks())
    assert all(line.endswith(" passes") for line in checks)
    assert printed(cells["restitutions"]).endswith(": True\n")  # the closed forms
    drawn = [
        picture
        for name in ("motion", "balance-figures")
        for html in shown(cells[name], "text/html")
        for picture in pictures(html)
    ]
    drawn += [Image.open(io.BytesIO(base64.b64decode(png))) for png in shown(cells["closed-forms"], "image/png")]
    assert [np.asarray(picture.convert("L")).std() > 5 for picture in drawn] == [True] * 4
    (film,) = pictures(shown(cells["film"], "text/html")[0])
    assert film.n_frames == 33  # 12 s at three times real time are 4 s, at 8 pictures a second, and the last one
