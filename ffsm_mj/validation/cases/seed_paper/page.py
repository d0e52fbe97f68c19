"""``docs/reproduction.md`` and ``docs/appendix-a.md``: every printed number beside ours, and what the numbers rest on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.report.markdown import markdown_table
from ffsm_mj.report.output_place import usable_folder
from ffsm_mj.validation.case import ComparedNumber, verdicts_in_words
from ffsm_mj.validation.cases.seed_paper import PAGE
from ffsm_mj.validation.cases.seed_paper.appendix import APPENDIX_PAGE, appendix_page
from ffsm_mj.validation.cases.seed_paper.drift import DriftExperiment, drift, reach
from ffsm_mj.validation.cases.seed_paper.printed import PAPER_FIGURES, PRINTED, PrintedNumber
from ffsm_mj.validation.cases.seed_paper.runs import (
    LONG_RUNS,
    STEPS_S,
    THRESHOLD,
    VELOCITY,
    Result,
    decided_runs,
    hold_runs,
    paper_run,
    tip_state,
)
from ffsm_mj.validation.page import decimals, fixed, from_template, numbers_table, small


def stated_inputs() -> list[tuple[str, str, str]]:
    """Name, printed text and our value of each input."""
    baseline, flying = prepare("baseline").assemble(), prepare("free-flying").assemble()
    return [*_bodies(baseline), *_start(baseline), *_control(baseline), *_free_flying(flying)]


def _numbers(values: Iterable[Any]) -> str:
    return ", ".join(f"{float(value):.5g}" for value in values)


def _bodies(assembly: Assembly) -> list[tuple[str, str, str]]:
    model = assembly.system.mj
    links = [model.body(f"robot/link_{i}") for i in (1, 2, 3)]
    base, box, payload = model.body("robot/base"), model.body("object/box"), model.body("robot/payload")
    lengths = [model.body(name).pos[0] for name in ("robot/link_2", "robot/link_3", "robot/payload")]
    side = 2.0 * model.geom("object/box").size[:2]
    return [
        ("mass of links, kg", "2, 2, 2", _numbers(link.mass[0] for link in links)),
        ("length of links, m", "2, 2, 2", _numbers(lengths)),
        ("centre of mass of links, m", "1, 1, 1", _numbers(link.ipos[0] for link in links)),
        ("inertia of links, kg m^2", "0.6667, 0.6667, 0.6667", _numbers(link.inertia[2] for link in links)),
        ("mass of load, kg", "1", _numbers(payload.mass)),
        ("mass of base, kg", "5", _numbers(base.mass)),
        ("inertia of base, kg m^2", "2.0833", _numbers([base.inertia[2]])),
        ("mass of object, kg", "5", _numbers(box.mass)),
        ("inertia of object, kg m^2", "0.8333", _numbers([box.inertia[2]])),
        ("side of object, m", "1, 1", _numbers(side)),
    ]


def _start(assembly: Assembly) -> list[tuple[str, str, str]]:
    tip, _ = tip_state(assembly.system, assembly.data)
    qpos = assembly.data.qpos
    return [
        ("object at the start: x, y, yaw, m, rad", "3.5, -0.5, 0", _numbers(qpos[6:9])),
        ("base at the start: x, y, yaw, m, rad", "5, -1.75, 0.1", _numbers(qpos[:3])),
        ("tip at the start, m", "7.5, 1.5", _numbers(np.round(tip[:2], 8))),
        ("angle of the third link, rad", "0.1", _numbers([qpos[2:6].sum()])),
    ]


def _control(assembly: Assembly) -> list[tuple[str, str, str]]:
    scenario, task = assembly.scenario, assembly.scenario.task
    approach, pause, regulate = scenario.phases
    motors = [scenario.actuators[f"motor_{i}"] for i in (1, 2, 3)]
    return [
        ("target of the tip, m", "3, 0", _numbers(task.target_m if task else ())),
        ("t_f, s", "30", _numbers([scenario.duration_s])),
        ("Q", "diag(1, 1, 0.5, 0.5)", f"diag({_numbers(approach.controller.Q)})"),
        ("R before the impact", "I", f"diag({_numbers(approach.controller.R)})"),
        ("R after the pause", "0.1 I", f"diag({_numbers(regulate.controller.R)})"),
        ("safety pause, s", "2.3", _numbers([pause.for_s])),
        ("stall torque of motors, N m", "14, 14, 14", _numbers(getattr(m, "stall_torque_N_m", np.nan) for m in motors)),
        ("no-load speed, rad/s", "0.54, 0.54, 0.54", _numbers(getattr(m, "no_load_speed_rad_s", np.nan) for m in motors)),
    ]


def _free_flying(assembly: Assembly) -> list[tuple[str, str, str]]:
    actuators, pause = assembly.scenario.actuators, assembly.scenario.phases[1]
    gains, thruster, wheel = pause.controller, actuators["thruster_x"].model_dump(), actuators["wheel"].model_dump()
    return [
        ("4.4: safety pause, s", "4.6", _numbers([pause.for_s])),
        ("4.4: K_p,t, K_d,t", "50, 0.75 K_p", _numbers([gains.translation.kp, gains.translation.kd])),
        ("4.4: K_p,r, K_d,r", "200, 0.75 K_p", _numbers([gains.rotation.kp, gains.rotation.kd])),
        ("4.4: K_p,a, K_d,a", "150, 0.75 K_p", _numbers([gains.arm.kp, gains.arm.kd])),
        ("4.4: thrust, threshold, N", "50, 1", _numbers([thruster["force_N"], thruster["threshold_N"]])),
        (
            "4.4: wheel's stall torque, N m, no-load speed, rad/s",
            "20, 2",
            _numbers([wheel["stall_torque_N_m"], wheel["no_load_speed_rad_s"]]),
        ),
    ]


PAGES = (PAGE, APPENDIX_PAGE)

_FACE_X_M = 4.001  # where the tip of a gripper of 1 mm radius touches the face
_AT_STEP = "at the 1 mm step"
_HEAD = ("quantity", "source", "ours", "difference", "tolerance", "verdict")
_STUDIED = (
    ("baseline", "impact_time", "time of impact, s", 5),
    ("baseline", "impulse", "impulse I_e,n, N s", 5),
    ("baseline", "smallest_error", "smallest tip error, m", 4),
    ("baseline", "final_error", "tip error at 30 s, m", 4),
    ("no-actuation", "object_way", "way of the object, m", 4),
    ("free-flying", "final_error_mm", "final tip error, mm", 2),
    ("slow-impact", "impulse", "impulse I_e,n, N s", 5),
)
_TABLES = {
    "study": "What the step size changes",
    "parameterizations": "The two parameterizations of A",
    "drift": "The main result, as an experiment",
}
"""Headings of the tables that only the runs of the study can tell."""

Results = Mapping[Any, Result]


def is_study(results: Results) -> bool:
    """Whether these are all the runs of the page, not only those of the printed numbers."""
    return VELOCITY in results


def compared_numbers(results: Results) -> tuple[ComparedNumber, ...]:
    """Every printed number beside ours, in the paper's order; with the runs of the study, the spread is theirs."""
    numbers = [_studied(number, results) if is_study(results) else number for number in PRINTED]
    return tuple(ComparedNumber(number, results[paper_run(number.scenario)].values[number.key]) for number in numbers)


def _studied(number: PrintedNumber, results: Results) -> PrintedNumber:
    """A number with the spread over the step sizes and over both ways of declaring the impact; rounding alone is none."""
    runs = [*decided_runs(number.scenario), *([THRESHOLD] if number.scenario == THRESHOLD.scenario else [])]
    values = [results[run].values[number.key] for run in runs if number.key in results[run].values]
    spread = max(values) - min(values)
    return replace(number, spread=spread if spread >= 1e-9 else 0.0)


def pages(results: Results, committed: str = "") -> dict[str, str]:
    """Text of the pages by file name.

    Args:
        results: The runs of the printed numbers, or of the whole study.
        committed: Without the study: the page whose tables of it are taken over.
    """
    compared = compared_numbers(results)
    if is_study(results):
        tables = {"study": _study(results), "parameterizations": _parameterizations(results), "drift": _drift(results)}
    else:
        tables = {part: _table_below(committed, heading) for part, heading in _TABLES.items()}
    sections = dict.fromkeys(number.section for number in PRINTED)
    parts = {
        "total": verdicts_in_words(compared),
        "inputs": markdown_table(("input", "paper", "ours"), stated_inputs()),
        **{f"section_{_key(section)}": _section(section, compared, results) for section in sections},
        **tables,
        "reach": fixed(reach(prepare("baseline").system), 2),
    }
    return {PAGE: from_template(PAGE, parts), APPENDIX_PAGE: appendix_page()}


def save_figures(folder: Path, results: Results) -> Path:
    """Write the figures of the page from the runs of the study; returns their folder.

    Raises:
        InputError: The folder cannot be written to.
        OutputLostError: A figure could not be written to its end.
    """
    from ffsm_mj.report import plots
    from ffsm_mj.validation.cases.seed_paper.figures import save_drift, save_study

    figures = folder / "figures"
    usable_folder(figures)
    save_study(results, figures / "reproduction-study.png")
    save_drift(_drifts(results), figures / "reproduction-drift.png")
    for scenario in dict.fromkeys(figure.scenario for figure in PAPER_FIGURES):
        names = [figure.name for figure in PAPER_FIGURES if figure.scenario == scenario]
        plots.save(results[paper_run(scenario)].kept, figures / scenario, names, ("svg",))
    return figures


def _table_below(page: str, heading: str) -> str:
    """The first table below a heading of a page; empty if there is none."""
    lines = page.partition(f"\n## {heading}\n")[2].partition("\n## ")[0].splitlines()
    return "\n".join(line for line in lines if line.startswith("|"))


def _key(section: str) -> str:
    return section.lower().replace(".", "_").replace(" ", "_")


def _section(section: str, compared: Sequence[ComparedNumber], results: Results) -> str:
    """One of the paper's sections: its table, what explains it, its figures."""
    rows = [c for printed, c in zip(PRINTED, compared, strict=True) if printed.section == section]
    scenario = next(printed.scenario for printed in PRINTED if printed.section == section)
    declared = results[THRESHOLD].values if scenario == THRESHOLD.scenario else {}
    at_step = {c.number.key: fixed(declared[c.number.key], decimals(c.number)) for c in rows if c.number.key in declared}
    head = (*_HEAD[:3], *([_AT_STEP] if at_step else []), *_HEAD[3:])
    figures = [f"Paper, {f.number}: {f.what}.\n\n![{f.what}]({f.file})" for f in PAPER_FIGURES if f.section == section]
    return "\n\n".join([numbers_table(rows, head, {_AT_STEP: at_step}), *_notes(rows), *figures])


def _notes(rows: Sequence[ComparedNumber]) -> list[str]:
    """Reasons of differences and of tolerances, each once, with the quantities that it is for."""
    explained: dict[str, list[str]] = {}
    for c in rows:
        if why := c.number.known or c.number.why:
            explained.setdefault(why, []).append(c.number.name)
    return ["\n".join(f"- {', '.join(names)}: {why}." for why, names in explained.items())] if explained else []


def _study(results: Results) -> str:
    head = ["quantity", *(f"{1e3 * step:g} ms" for step in STEPS_S), "spread", *(f"both {1e3 * s:g} ms" for s in STEPS_S)]
    rows = []
    for scenario, key, name, digits in _STUDIED:
        cells = [f"{scenario}: {name}"]
        for runs in (hold_runs(scenario), decided_runs(scenario)):
            values = [results[run].values[key] for run in runs]
            cells += [*(fixed(value, digits) for value in values), small(max(values) - min(values))]
        rows.append(cells)
    return markdown_table([*head, "spread"], rows)


def _parameterizations(results: Results) -> str:
    columns = [_behaviour(results[run]) for run in (paper_run("baseline"), VELOCITY)]
    printed = ("7.77", "1.2226", "7.77", "-0.3172", "0.118", "1.169")
    rows = ([name, text, columns[0][name], columns[1][name]] for name, text in zip(columns[0], printed, strict=True))
    return markdown_table(["", "paper", "`output_stack`", "`velocity`"], rows)


def _behaviour(result: Result) -> dict[str, str]:
    """First impact, where the tip first is as far to the left as at a touch of the face, and the errors."""
    run, values = result.kept, result.values
    row = int(np.argmax(run["state.tip_x_m"] <= _FACE_X_M))
    crossing = float(run.time[row]), float(run["state.tip_y_m"][row])
    if "impact_time" in values:
        crossing = min(crossing, (values["impact_time"], values["tip_y"]))
    return {
        "first impact, s": fixed(values["impact_time"], 3) if "impact_time" in values else "none",
        "impulse there, N s": fixed(run.impacts[0].impulse_N_s, 4) if run.impacts else "",
        "tip at x = 4.001 m, s": fixed(crossing[0], 2),
        "its y there, m": fixed(crossing[1], 3),
        "smallest tip error, m": fixed(values["smallest_error"], 4),
        "tip error at 30 s, m": fixed(values["final_error"], 4),
    }


def _drift(results: Results) -> str:
    head = (
        "run",
        "P, N s",
        "P / m, m/s",
        "mass centre, m/s",
        "difference, m/s",
        "smallest error, m",
        "error at 120 s, m",
        "lost after, s",
    )
    rows = (
        [
            name,
            fixed(d.momentum_N_s, 4),
            fixed(d.momentum_N_s / d.mass_kg, 5),
            fixed(d.rate_m_s, 5),
            small(abs(d.rate_m_s - d.momentum_N_s / d.mass_kg)),
            small(float(d.error_m.min())),
            f"{d.error_m[-1]:.2g}",
            fixed(d.lost_s, 0 if d.lost_s > 1000.0 else 1),
        ]
        for name, d in _drifts(results).items()
    )
    return markdown_table(head, rows)


def _drifts(results: Results) -> dict[str, DriftExperiment]:
    system = prepare("baseline").system
    return {name: drift(results[run].kept, system) for name, run in LONG_RUNS.items()}
