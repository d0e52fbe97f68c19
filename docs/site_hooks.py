"""What the site has besides the pages of docs/: pages of the root, notebooks, the reference of the Python names."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
API = {
    "Scenario": ("What is simulated.", "ffsm_mj.assembly.prepare.Scenario", "ffsm_mj.scenario.models"),
    "Run": (
        "What came out, and how a run is made and read.",
        *("ffsm_mj.assembly.prepare.run", "ffsm_mj.assembly.prepare.resume"),
        *("ffsm_mj.analysis.run.load_run", "ffsm_mj.analysis.run.Run", "ffsm_mj.analysis.run.compare"),
    ),
    "Simulator": (
        "A simulation in a loop of your own.",
        *("ffsm_mj.assembly.simulator.Simulator", "ffsm_mj.assembly.simulator.SimulatorState"),
    ),
    "Campaign": (
        "A scenario repeated: `ffsm_mj.Campaign`, `sweep`, `compare_campaigns`.",
        *("ffsm_mj.experiments.campaign.Campaign", "ffsm_mj.experiments.campaign.sweep"),
        "ffsm_mj.experiments.campaign.compare_campaigns",
    ),
    "Functions of a run": (
        "`ffsm_mj.explain`, `summary`, `effort`, `base_rotation`, `angular_momentum`, `plot`, `animate`, `sensitivity`.",
        *("ffsm_mj.replay.explain", "ffsm_mj.analysis.run_models", "ffsm_mj.report.plots.notebook.plot"),
        *(
            "ffsm_mj.report.animation.animate",
            "ffsm_mj.experiments.sensitivity.sensitivity",
            "ffsm_mj.report.progress.progress",
        ),
    ),
    "Impacts": ("`ffsm_mj.impact`, usable alone on any MuJoCo model.", "ffsm_mj.contact_models.impact"),
    "Impact map": ("`ffsm_mj.impact_map`.", "ffsm_mj.experiments.impact_map.impact_map.impact_map"),
    "Gymnasium": (
        "`ffsm_mj.gym`: scenarios as environments.",
        *("ffsm_mj.gym.make", "ffsm_mj.gym.env.ScenarioEnv", "ffsm_mj.gym.rewards", "ffsm_mj.gym.policies"),
    ),
    "Control laws": ("What a law of your own imports.", "ffsm_mj.controller_protocol"),
    "Task model": ("Dynamics of the driven joints with all else floating.", "ffsm_mj.task_model"),
    "Contact models": ("The interface of contact models.", "ffsm_mj.contact_models.interface"),
    "Fields": ("The interface of external fields.", "ffsm_mj.fields.interface"),
    "Records": ("Records of events.", "ffsm_mj.records.events", "ffsm_mj.records.record", "ffsm_mj.records.kinds"),
    "Log replay": ("Recompute a run from the states in its log.", "ffsm_mj.replay"),
    "pytest": ("Fixtures and assertions for tests on logged data.", "ffsm_mj.pytest_plugin"),
    "Errors": ("Exceptions.", "ffsm_mj.errors"),
}
"""Title of each page of the reference, what it begins with, and the names that it documents."""
RUNS = sorted((ROOT / "build" / "gallery").glob("*.html"))
"""Pages of runs of the shipped scenarios, by ``make gallery``; none: the gallery leads to the pages that explain them."""
PROJECT = {"contributing.md": "Contributing", "security.md": "Security", "changelog.md": "Changes"}
_ENTRY = re.compile(r"^- \[([^\]]+)\]\(([^)]+)\): (.+)$", re.MULTILINE)
_SUMMARY = (
    "Event-driven simulation of free-floating space manipulators with exact impacts, contact and grasps, on MuJoCo. "
    "A YAML scenario or a Python object goes in; a motion, its log (MCAP) and a verification of the physics come out."
)
_USE = (
    "Command line: `ffsm run SCENARIO`, `ffsm check SCENARIO`, `ffsm analyze RUN`, `ffsm view RUN`. "
    "Python: `ffsm_mj.run(scenario, overrides)`, `ffsm_mj.load_run(path)`. SI units; quaternions w x y z; world frame."
)
_ROLE = re.compile(r":(?:mod|class|func|meth|attr):<code>~?([^<]*)</code>")


def index() -> dict[str, list[tuple[str, str, str]]]:
    """The pages that the user guide lists by topic: title, file in docs/, and what it answers."""
    topics = re.split(r"^## ", (ROOT / "docs" / "user-guide.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    listed = {topic.partition("\n")[0]: _ENTRY.findall(topic) for topic in topics}
    return {title: entries for title, entries in listed.items() if entries}


def llms_txt(place: str = "docs/") -> str:
    """The index for language models (llmstxt.org), with links to the files of the checkout or pages of the site."""
    lines = ["# ffsm-mj", "", f"> {_SUMMARY}", "", _USE]
    for title, entries in index().items():
        lines += ["", f"## {title}", "", *(f"- [{name}]({place}{file}): {answer}" for name, file, answer in entries)]
    return "\n".join(lines) + "\n"


def on_config(config: Any) -> Any:
    """The navigation: the topics of the user guide, the project's own pages, the reference of the Python names."""
    topics = [{title: [{name: _page(file)} for name, file, _ in entries]} for title, entries in index().items()]
    reference = ["api/index.md", *({title: _place(title)} for title in API)]
    project = [{title: place} for place, title in PROJECT.items()]
    config.nav = [{"Home": "index.md"}, "user-guide.md", *topics, {"Python reference": reference}, {"Project": project}]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made."""
    from mkdocs.structure.files import File

    made = {"index.md": _from_root("README.md"), "llms.txt": llms_txt("").replace(".ipynb)", ".md)").replace(".md)", "/)")}
    made |= {place: _from_root(place.replace(".md", "").upper() + ".md") for place in PROJECT}
    made["api/index.md"] = "\n".join(
        ["# Python reference\n", *(f"- [{title}]({_place(title)[4:]}): {API[title][0]}" for title in API)]
    )
    made |= {f"notebooks/{path.stem}.md": _notebook(path) for path in NOTEBOOKS}
    made |= {_place(title): _reference(title, *parts) for title, parts in API.items()}
    for place, text in made.items():
        files.append(File.generated(config, place, content=text))
    for page in RUNS:
        files.append(File.generated(config, f"gallery/{page.name}", abs_src_path=str(page)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Where GitHub shows a notebook the site has a page; pictures of the gallery open the pages of runs that were made."""
    for run in RUNS if page.file.src_uri == "gallery.md" else ():
        markdown = re.sub(rf"(gallery/{run.stem}\.png\)\]\()[\w-]+\.md(#[\w-]+)?", rf"\1gallery/{run.name}", markdown)
    return re.sub(r"(\]\([\w/.-]*)\.ipynb", r"\1.md", markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Docstrings refer to names as Sphinx does."""
    return _ROLE.sub(r"<code>\1</code>", html)


def _page(file: str) -> str:
    """A page of the site of a file of docs/."""
    return file.replace(".ipynb", ".md")


def _place(title: str) -> str:
    return f"api/{title.lower().replace(' ', '-')}.md"


def _from_root(name: str) -> str:
    """A page that stands beside docs/, with links that hold inside it."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
    return re.sub(r"\]\(([A-Z]+\.md)", lambda found: f"]({found[1].lower()}", text)


def _reference(title: str, begins: str, *names: str) -> str:
    less = "---\nsearch:\n  boost: 0.5\n---"  # of two pages that have a word the one that explains comes first
    return "\n\n".join([less, f"# {title}", begins, *(f"::: {name}" for name in names)])


def _notebook(path: Path) -> str:
    """The cells of a notebook with what they print and show."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        language = "sh" if text.startswith("%%sh") else "python"
        parts.append(text if cell["cell_type"] == "markdown" else f"```{language}\n{text.removeprefix('%%sh').strip()}\n```")
        for output in cell.get("outputs", []):
            if "text" in output:
                parts.append(f"```text\n{''.join(output['text']).rstrip()}\n```")
            else:
                ((form, data),) = output["data"].items()
                shown = "".join(data)
                parts.append(f'<img alt="" src="data:image/png;base64,{shown}">' if form == "image/png" else shown)
    return "\n\n".join(parts)


if __name__ == "__main__":
    print(llms_txt(), end="")
