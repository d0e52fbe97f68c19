"""What the site has besides the pages of docs/: pages of the root, the tour, the reference of the Python names."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent
API = {
    "Runs": (
        "`ffsm_mj.Scenario`, `run`, `load_run`, `compare` and their results.",
        *(
            "ffsm_mj.assembly.prepare.Scenario",
            "ffsm_mj.scenario.models",
            "ffsm_mj.assembly.prepare.run",
            "ffsm_mj.analysis.run.load_run",
            "ffsm_mj.analysis.run.Run",
        ),
        "ffsm_mj.analysis.run.compare",
    ),
    "Functions of a run": (
        "`ffsm_mj.explain`, `summary`, `effort`, `base_rotation`, `angular_momentum`, `plot`, `animate`, `sensitivity`.",
        *("ffsm_mj.analysis.run_models", "ffsm_mj.report.plots.notebook.plot", "ffsm_mj.report.animation.animate"),
        "ffsm_mj.experiments.sensitivity.sensitivity",
    ),
    "Campaigns": (
        "`ffsm_mj.Campaign` and `ffsm_mj.sweep`.",
        *("ffsm_mj.experiments.campaign.Campaign", "ffsm_mj.experiments.campaign.sweep"),
    ),
    "Gymnasium": (
        "`ffsm_mj.gym`: scenarios as environments.",
        *("ffsm_mj.gym.make", "ffsm_mj.gym.env.ScenarioEnv", "ffsm_mj.gym.rewards", "ffsm_mj.gym.policies"),
    ),
    "Impacts": ("`ffsm_mj.contact_models.impact`, usable alone on any MuJoCo model.", "ffsm_mj.contact_models.impact"),
    "Control laws": ("The interface of control laws.", "ffsm_mj.controller_protocol"),
    "Contact models": ("The interface of contact models.", "ffsm_mj.contact_models.interface"),
    "Records": ("Records of events.", "ffsm_mj.records.events", "ffsm_mj.records.record", "ffsm_mj.records.kinds"),
    "Log replay": ("Recompute a run from the states in its log.", "ffsm_mj.replay"),
    "pytest": ("Fixtures and assertions for tests on logged data.", "ffsm_mj.pytest_plugin"),
    "Errors": ("Exceptions.", "ffsm_mj.errors"),
}
"""Title of each page, what it begins with, and the names that it documents."""
_ROLE = re.compile(r":(?:mod|class|func|meth|attr):<code>~?([^<]*)</code>")


def on_config(config: Any) -> Any:
    """Put the reference at the end of the navigation."""
    config.nav.append({"Python": [{title: _place(title)} for title in API]})
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made."""
    made = {"index.md": _from_root("README.md"), "changelog.md": _from_root("CHANGELOG.md"), "tour.md": _tour()}
    made |= {"contributing.md": _from_root("CONTRIBUTING.md"), "security.md": _from_root("SECURITY.md")}
    made |= {_place(title): _reference(title, *parts) for title, parts in API.items()}
    for place, text in made.items():
        files.append(File.generated(config, place, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Where GitHub shows the notebook the site has a page."""
    return markdown.replace("](tour.ipynb", "](tour.md")


def on_page_content(html: str, **_: Any) -> str:
    """Docstrings refer to names as Sphinx does."""
    return _ROLE.sub(r"<code>\1</code>", html)


def _place(title: str) -> str:
    return f"api/{title.lower().replace(' ', '-')}.md"


def _from_root(name: str) -> str:
    """A page that stands beside docs/, with links that hold inside it."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
    return re.sub(r"\]\(([A-Z]+\.md)", lambda found: f"]({found[1].lower()}", text)


def _reference(title: str, begins: str, *names: str) -> str:
    less = "---\nsearch:\n  boost: 0.5\n---"  # of two pages that have a word the one that explains comes first
    return "\n\n".join([less, f"# {title}", begins, *(f"::: {name}" for name in names)])


def _tour() -> str:
    """The cells of the notebook, without what they print."""
    cells = json.loads((ROOT / "docs/tour.ipynb").read_text(encoding="utf-8"))["cells"]
    texts = [("".join(cell["source"]), cell["cell_type"]) for cell in cells]
    return "\n\n".join(f"```python\n{text}\n```" if kind == "code" else text for text, kind in texts)
