"""``docs/engines.md`` from the JSON of a run: tables, and sentences that the numbers make."""

from __future__ import annotations

from pathlib import Path
from string import Template
from typing import Any

from engine_runs.costs import OURS, PANELS, Panel, Row, Setting, best, cheapest, cost_at, settings
from engine_runs.figure import draw
from ffsm_mj.report.markdown import markdown_table

TEMPLATE = Path(__file__).with_name("page.md")
DETAILS: dict[str, dict[str, str]] = {
    "collision, e = 1": {"energy_ratio": "energy after / before", "P": "P", "L": "L", "position_m": "positions, m"},
    "collision, e = 0.5": {"energy_ratio": "energy after / before", "P": "P", "L": "L", "position_m": "positions, m"},
    "grip": {"slip_m": "slip in 2 s, m", "P": "momentum missing"},
    "flight": {"energy": "energy", "P": "P", "L": "L"},
    "weld": {"drift_m": "drift, m", "drift_rad": "drift, rad", "load": "load", "P": "P", "L": "L", "energy": "energy"},
}
ROUNDING = 1e-12


def number(value: float) -> str:
    """An error to one or two digits."""
    return "0" if value == 0.0 else f"{abs(value):.1e}".replace("e-0", "e-").replace("e+00", "")


def goal(value: float) -> str:
    """An error to undercut."""
    return f"{value:g}".replace("e-0", "e-")


def ratio(value: float) -> str:
    """How many times a cost is that of ours."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def called(setting: Setting) -> str:
    """Engine and setting in a sentence."""
    return "ffsm-mj" if setting == OURS else f"{setting[0]} ({setting[1]})"


def listed(words: list[str]) -> str:
    """With commas and a last and."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def cost_table(rows: list[Row], panel: Panel) -> str:
    """Smallest error of each setting, and its cost at equal errors beside ours."""
    found = settings(rows, panel)
    head = ["engine", "setting", "smallest error", "at", "cost"]
    head += [f"cost at {goal(target)}" for target in panel.targets]
    lines = []
    for (engine, name), runs in found.items():
        least = best(runs, panel)
        cells = [engine, name, number(least["errors"][panel.key]), least["value"], number(least["cost"])]
        for target in panel.targets:
            cost, reference = cost_at(runs, panel, target), cost_at(found[OURS], panel, target)
            with_ratio = f" ({ratio(cost / reference)})" if cost is not None and reference is not None else ""
            cells.append("" if cost is None else number(cost) + with_ratio)
        lines.append(cells)
    return markdown_table(head, lines)


def detail_table(rows: list[Row], panel: Panel) -> str:
    """What else the run with the smallest error of each setting has."""
    columns = DETAILS[panel.scene]
    lines = []
    for (engine, name), runs in settings(rows, panel).items():
        values = best(runs, panel)["errors"]
        cells = [f"{values[key]:.6f}" if key == "energy_ratio" else number(values[key]) for key in columns]
        lines.append([engine, name, *cells])
    return markdown_table(["engine", "setting", *columns.values()], lines)


def verdicts(rows: list[Row], panel: Panel) -> str:
    """A sentence for each error, or for several with the same verdict: who reaches it, and at what cost beside ours."""
    found = settings(rows, panel)
    sentences: dict[str, list[str]] = {}
    for target in panel.targets:
        sentences.setdefault(_verdict(found, panel, target), []).append(goal(target))
    return "\n".join(f"- Error of {listed(targets)}: {sentence}" for sentence, targets in sentences.items())


def _verdict(found: dict[Setting, list[Row]], panel: Panel, target: float) -> str:
    reached, ours = cheapest(found, panel, target), cost_at(found[OURS], panel, target)
    if not reached or ours is None:
        return "not reached by ffsm-mj." if reached else "reached by none."
    others = [(cost, setting) for cost, setting in reached if setting != OURS]
    if not others:
        return "reached by ffsm-mj alone."
    cost, setting = others[0]
    engines = listed(sorted({other[0] for _, other in others}))
    return f"reached by {engines} too; the cheapest, {called(setting)}, takes {_compared(cost, ours)} ffsm-mj."


def _compared(cost: float, ours: float) -> str:
    """A cost beside ours; on a busy machine a tenth is no difference."""
    if abs(cost - ours) < 0.1 * ours:
        return "about the CPU time of"
    return f"{ratio(ours / cost)} times less CPU time than" if cost < ours else f"{ratio(cost / ours)} times the CPU time of"


def restitution(rows: list[Row]) -> str:
    """Who takes e as an input, and how near the velocities come."""
    panel = PANELS[1]
    found = settings(rows, panel)
    least = {setting: best(runs, panel)["errors"][panel.key] for setting, runs in found.items()}
    inputs = {setting: error for setting, error in least.items() if takes_restitution(setting)}
    exact = [called(setting) for setting, error in inputs.items() if error <= ROUNDING]
    near = [f"{called(setting)} to {number(error)}" for setting, error in inputs.items() if error > ROUNDING]
    calibrated = [
        f"{called(setting)} to {number(error)}" for setting, error in least.items() if setting not in inputs and error < 0.1
    ]
    return (
        f"Velocities after the impact at e = 0.5, where a restitution is an input: to rounding by {listed(exact)};"
        f" by {listed(near)}. With a spring, dashpot or dissipation calibrated for this e, in Drake for this approach"
        f" speed too: by {listed(calibrated)}."
    )


def takes_restitution(setting: Setting) -> bool:
    """Whether e is a number of the model."""
    return setting[0] in ("ffsm-mj", "Bullet", "Exudyn", "Newton", "ODE", "Pinocchio", "Siconos")


def better(rows: list[Row]) -> str:
    """Where another engine is cheaper than ours at equal error; errors with the same cheapest setting in one line."""
    lines = []
    for panel in PANELS:
        found = settings(rows, panel)
        groups: dict[Setting, list[tuple[float, float]]] = {}
        for target in panel.targets:
            ours, reached = cost_at(found[OURS], panel, target), cheapest(found, panel, target)
            if ours is not None and reached and reached[0][1] != OURS:
                groups.setdefault(reached[0][1], []).append((target, ours / reached[0][0]))
        for setting, cases in groups.items():
            ratios = [ratio(case[1]) for case in cases]
            times = ratios[0] if len(set(ratios)) == 1 else f"{ratios[0]} ... {ratios[-1]}"
            lines.append([panel.title, ", ".join(goal(case[0]) for case in cases), called(setting), times])
    return markdown_table(["scene and error", "at errors of", "cheapest", "times cheaper than ffsm-mj"], lines)


def write(data: dict[str, Any], folder: Path) -> None:
    """``engines.md`` and ``figures/engines.svg`` in a folder."""
    (folder / "engines.md").write_text(text(data), encoding="utf-8")
    draw(data["rows"], folder / "figures")


def text(data: dict[str, Any]) -> str:
    """The page."""
    rows = data["rows"]
    parts = {
        "versions": ", ".join(f"{name} {version}" for name, version in data["versions"].items()),
        "restitution": restitution(rows),
        "better": better(rows),
    }
    for i, panel in enumerate(PANELS):
        parts |= {
            f"costs_{i}": cost_table(rows, panel),
            f"details_{i}": detail_table(rows, panel),
            f"verdicts_{i}": verdicts(rows, panel),
        }
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(parts)
