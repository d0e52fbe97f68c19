"""The notebooks of docs/notebooks: executed, and stored with what they print and show (``make notebooks``).

Stored outputs are text on stdout and pictures: what differs from machine to machine, such as paths, wall times and execution
counts, is left out. ``tests/test_notebooks.py`` executes them and compares.
"""

from __future__ import annotations

import base64
import io
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
_METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
_SHOWN = ("image/png", "text/html", "text/plain")
"""Forms of a value, of which the first that there is is stored."""
_EMBEDDED = re.compile(r"(?<=data:image/png;base64,)[^\"]+")


def executed(path: Path, folder: Path) -> Any:
    """A notebook with its outputs, after all cells ran in a folder; a cell that raises raises here."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(folder)}})
    commands = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"  # ffsm is that of this Python
    client.execute(env=os.environ | {"PATH": commands})
    return notebook


def stored(notebook: Any) -> Any:
    """What is kept of an executed notebook."""
    notebook.metadata = nbformat.from_dict(_METADATA)
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [kept for output in cell.outputs if (kept := _kept(output))]
            if text := printed(cell):  # a command's comes in parts
                cell.outputs = [output for output in cell.outputs if output.output_type != "stream"]
                cell.outputs.insert(0, nbformat.v4.new_output("stream", name="stdout", text=text))
    return notebook


def printed(cell: Any) -> str:
    """What a cell printed on stdout."""
    streams = [output for output in cell.get("outputs", []) if output.output_type == "stream"]
    return "".join(output.text for output in streams if output.name == "stdout")


def _kept(output: Any) -> Any:
    if output.output_type == "stream":
        return nbformat.v4.new_output("stream", name="stdout", text=output.text) if output.name == "stdout" else None
    form = next((form for form in _SHOWN if form in output.data), None)
    if form is None:
        return None
    data = output.data[form]
    if form == "image/png":
        data = _smaller(data)
    elif form == "text/html":
        data = _EMBEDDED.sub(lambda png: _smaller(png[0]), data)
    return nbformat.v4.new_output("display_data", {form: data})


def _smaller(png: str) -> str:
    """A picture in base64 with 48 colours, a fourth of the bytes: lines and letters look the same."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB").quantize(48)
    written = io.BytesIO()
    picture.save(written, format="PNG", optimize=True)
    return base64.b64encode(written.getvalue()).decode("ascii")


def main() -> None:
    """Execute all notebooks, or those named, and store their outputs."""
    for path in [path for path in NOTEBOOKS if path.stem in sys.argv[1:] or not sys.argv[1:]]:
        with tempfile.TemporaryDirectory() as folder:
            nbformat.write(stored(executed(path, Path(folder))), path)


if __name__ == "__main__":
    main()
