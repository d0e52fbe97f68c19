"""``docs/reproduction.md``: every printed number beside ours, and what the numbers rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ffsm_mj.comparison import Verdict, verdicts_in_words
from ffsm_mj.report.text_table import markdown_table
from ffsm_mj.reproduction.cases import STEPS_S, VELOCITY, Case, Result, paper_case
from ffsm_mj.reproduction.drift import DriftExperiment
from ffsm_mj.reproduction.judged import StudiedNumber, decided_cases
from ffsm_mj.reproduction.markdown import filled, fixed, small
from ffsm_mj.reproduction.printed import PAPER_FIGURES

PAGE = "reproduction.md"
INPUTS_HEAD = ("input", "paper", "ours")
_FACE_X_M = 4.001  # where the tip of a gripper of 1 mm radius touches the face
_STUDIED = (
    ("baseline", "impact_time", "time of impact, s", 5),
    ("baseline", "impulse", "impulse I_e,n, N s", 5),
    ("baseline", "smallest_error", "smallest tip error, m", 4),
    ("baseline", "final_error", "tip error at 30 s, m", 4),
    ("no-actuation", "object_way", "way of the object, m", 4),
    ("free-flying", "final_error_mm", "final tip error, mm", 2),
    ("slow-impact", "impulse", "impulse I_e,n, N s", 5),
)


@dataclass(frozen=True)
class Report:
    """Everything that the page tells.

    Attributes:
        judged: Printed numbers beside ours.
        results: The runs.
        drifts: The long runs by what they are.
        inputs: Name, printed text and our value of what the paper states of its case study.
        figures: Paths, relative to the page, of the figures of each scenario by name.
    """

    judged: tuple[StudiedNumber, ...]
    results: Mapping[Case, Result]
    drifts: Mapping[str, DriftExperiment]
    inputs: Sequence[tuple[str, str, str]]
    figures: Mapping[str, Mapping[str, str]]


def reproduction_page(report: Report) -> str:
    """The page."""
    sections = dict.fromkeys(c.number.section for c in report.judged)
    return filled(
        PAGE,
        {
            "total": verdicts_in_words(report.judged),
            "inputs": markdown_table(INPUTS_HEAD, report.inputs),
            **{f"section_{_key(section)}": _section(report, section) for section in sections},
            "study": _study(report.results),
            "parameterizations": _parameterizations(report.results),
            "drift": _drift(report.drifts),
            "reach": fixed(max(d.reach_m for d in report.drifts.values()), 2),
            "rate_difference": small(max(abs(d.rate_m_s - d.momentum_N_s / d.mass_kg) for d in report.drifts.values())),
        },
    )


def _key(section: str) -> str:
    return section.lower().replace(".", "_").replace(" ", "_")


def _section(report: Report, section: str) -> str:
    """One of the paper's sections: its table, what explains it, its figures."""
    rows = [c for c in report.judged if c.number.section == section]
    figures = [
        f"Paper, {f.number}: {f.what}.\n\n![{f.what}]({report.figures[f.scenario][f.name]})"
        for f in PAPER_FIGURES
        if f.section == section and f.name in report.figures.get(f.scenario, {})
    ]
    return "\n\n".join([_judged_table(rows), *_notes(rows), *figures])


def _judged_table(rows: Sequence[StudiedNumber]) -> str:
    declared = any(c.threshold is not None for c in rows)
    head = ["quantity", "paper", "ours", *(["at the 1 mm step"] if declared else []), "difference", "tolerance", "verdict"]
    return markdown_table(head, (judged_cells(c, declared=declared) for c in rows))


def judged_cells(c: StudiedNumber, *, declared: bool) -> list[str]:
    """Cells of a printed number's row; ``declared``: the table has a column for the impact as the paper declares it."""
    vague = c.number.approximate or c.number.at_most
    decimals = c.number.decimals + (2 if vague else 1)
    sign = "about " if c.number.approximate else "at most " if c.number.at_most else ""
    left_open = small(c.number.allowed) if c.number.allowed else "0"
    threshold = [] if not declared else ["" if c.threshold is None else fixed(c.threshold, decimals)]
    return [
        c.number.quantity,
        sign + c.number.text,
        fixed(c.ours, decimals),
        *threshold,
        small(c.difference, 2),
        f"{left_open} + {small(c.spread)}",
        str(c.verdict) if c.verdict is Verdict.AGREES else f"**{c.verdict}**",
    ]


def _notes(rows: Sequence[StudiedNumber]) -> list[str]:
    """What explains a difference, once for all the numbers that it explains."""
    explained: dict[str, list[str]] = {}
    for c in rows:
        if c.number.known:
            explained.setdefault(c.number.known, []).append(c.number.name)
    return ["\n".join(f"- {', '.join(names)}: {why}." for why, names in explained.items())] if explained else []


def _study(results: Mapping[Case, Result]) -> str:
    head = ["quantity", *(f"{1e3 * step:g} ms" for step in STEPS_S), "spread", *(f"both {1e3 * s:g} ms" for s in STEPS_S)]
    rows = []
    for scenario, key, name, decimals in _STUDIED:
        held = [results[paper_case(scenario, step)].values[key] for step in STEPS_S]
        decided = [results[case].values[key] for case in decided_cases(scenario)]
        cells = [fixed(v, decimals) for v in held], [small(max(held) - min(held))], [fixed(v, decimals) for v in decided]
        rows.append(
            [f"{scenario}: {name}", *(cell for group in cells for cell in group), small(max(decided) - min(decided))]
        )
    return markdown_table([*head, "spread"], rows)


def _parameterizations(results: Mapping[Case, Result]) -> str:
    facts = [_facts(results[case]) for case in (paper_case("baseline"), VELOCITY)]
    printed = ("7.77", "1.2226", "7.77", "-0.3172", "0.118", "1.169")
    rows = ([name, text, facts[0][name], facts[1][name]] for name, text in zip(facts[0], printed, strict=True))
    return markdown_table(["", "paper", "`output_stack`", "`velocity`"], rows)


def _facts(result: Result) -> dict[str, str]:
    """First impact, where the tip first is as far to the left as at a touch of the face, and the errors."""
    run, values = result.run, result.values
    if run is None:
        raise ValueError("this run must be kept")
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


def _drift(drifts: Mapping[str, DriftExperiment]) -> str:
    head = ["run", "P, N s", "P / m, m/s", "mass centre, m/s", "smallest error, m", "error at 120 s, m", "lost after, s"]
    rows = (
        [
            name,
            fixed(d.momentum_N_s, 4),
            fixed(d.momentum_N_s / d.mass_kg, 5),
            fixed(d.rate_m_s, 5),
            small(float(d.error_m.min())),
            f"{d.error_m[-1]:.2g}",
            fixed(d.lost_s, 0) if d.lost_s > 1000.0 else fixed(d.lost_s, 1),
        ]
        for name, d in drifts.items()
    )
    return markdown_table(head, rows)
