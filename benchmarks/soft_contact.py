"""The baseline with MuJoCo's own contact in place of the exact impact: its best settings, at three step sizes.

``uv run python benchmarks/soft_contact.py`` prints the table and writes ``docs/soft-contact.md`` with its figure;
``--dry`` only prints. Models, control, limits and phases are those of the scenario ``baseline``; gripper and box collide in
MuJoCo, without friction (``condim="1"``), and the first contact begins the safety pause.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from string import Template

import mujoco
import numpy as np

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import Command, Observation
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, subtree_momenta
from ffsm_mj.records.events import ImpactRecord
from ffsm_mj.report.markdown import markdown_table
from ffsm_mj.validation.cases.seed_paper.runs import tip_state
from ffsm_mj.validation.page import fixed, small

STEPS_S = (1e-3, 5e-4, 1e-4)
PERIOD_S = 1e-3
SPRING_STEPS = 10
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)
ELASTIC = (0.995, 0.995, 0.001, 0.5, 2.0)
"""Impedance that MuJoCo's page on speculative contacts recommends for elastic impacts, beside zero stiffness."""
DOCS = Path(__file__).parent.parent / "docs"


@dataclass(frozen=True)
class Recipe:
    """How MuJoCo's contact is set."""

    name: str
    integrator: int
    solref: Callable[[float], tuple[float, float]]
    solimp: tuple[float, ...] = STIFF
    speculative: bool = False


def _spring(step_s: float) -> tuple[float, float]:
    """An undamped spring whose half period is ten steps."""
    return -((math.pi / (SPRING_STEPS * step_s)) ** 2), 0.0


def _dashpot(step_s: float) -> tuple[float, float]:
    """A dashpot that turns the approach speed round within one step."""
    return 0.0, -(2.0 / step_s - 1.0)


INTEGRATOR = mujoco.mjtIntegrator
RECIPES = (
    Recipe("spring, RK4", INTEGRATOR.mjINT_RK4, _spring),
    Recipe("dashpot, Euler", INTEGRATOR.mjINT_EULER, _dashpot),
    Recipe("dashpot, RK4", INTEGRATOR.mjINT_RK4, _dashpot),
    Recipe("defaults, RK4", INTEGRATOR.mjINT_RK4, lambda _: (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)),
    Recipe("elastic, Euler", INTEGRATOR.mjINT_EULER, _dashpot, ELASTIC),
    Recipe("elastic, Euler, speculative", INTEGRATOR.mjINT_EULER, _dashpot, ELASTIC, speculative=True),
)
EXACT = "exact (ffsm-mj)"


@dataclass(frozen=True)
class Outcome:
    """What a run came to; energies without the motors' work, momenta of the whole system, paths tick by tick."""

    recipe: str
    step_s: float
    first_contact_s: float
    steps_in_contact: int
    depth_m: float
    impulse_N_s: float
    energy_error: float
    momentum_end_N_s: float
    angular_momentum_end_N_m_s: float
    path: np.ndarray
    cpu_s: float


class SoftRun:
    """The baseline's loop with MuJoCo's contact; the record of an exact impact stands for the first touch in the phases."""

    def __init__(self, recipe: Recipe, step_s: float, hit: ImpactRecord) -> None:
        """Set up model and controller."""
        self.recipe, self.step_s, self.hit = recipe, step_s, hit
        self.assembly = prepare("baseline", [f"time_step_s={step_s}"]).assemble()
        self.model, self.data = self.assembly.system.mj, self.assembly.data
        self._let_touch()
        self.work_J = self.energy_before = self.energy_change = self.impulse = self.depth_m = 0.0
        self.contact_steps = []

    def _let_touch(self) -> None:
        model, recipe = self.model, self.recipe
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.integrator = int(recipe.integrator)
        if recipe.speculative:
            model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SPECULATIVE)
        model.geom_contype[:] = model.geom_conaffinity[:] = 0
        for name in ("gripper", "box"):
            geom = self.assembly.system.index("geom", name)
            model.geom_contype[geom] = model.geom_conaffinity[geom] = model.geom_condim[geom] = 1
            model.geom_solref[geom], model.geom_solimp[geom] = recipe.solref(self.step_s), recipe.solimp
        mujoco.mj_forward(model, self.data)

    def decide(self, time_s: float, command: Command, *, touched: bool = False) -> None:
        """Ask the controller; a touch ends the approach."""
        command.clear()
        mujoco.mj_forward(self.model, self.data)
        self.assembly.controller.control(Observation(time_s, self.data, (self.hit,) if touched else ()), command)
        self.assembly.controller.drain_phases()
        self.assembly.actuation.apply(command, self.data, time_s)

    def step(self, number: int) -> bool:
        """One step; returns whether the gripper touches after it."""
        before, effort = self.data.qpos.copy(), self.data.ctrl.copy()
        mujoco.mj_step(self.model, self.data)
        self.work_J += float(effort @ (self.data.qpos - before)[self.driven])
        mujoco.mj_fwdPosition(self.model, self.data)
        if self.data.ncon:
            self.contact_steps.append(number)
            self.depth_m = max(self.depth_m, -float(self.data.contact.dist.min()))
        return bool(self.data.ncon)

    @property
    def driven(self) -> np.ndarray:
        """Coordinates that the actuators drive: all joints here have one."""
        return self.model.jnt_qposadr[self.model.actuator_trnid[:, 0]]

    def energy(self) -> float:
        """Kinetic energy, J."""
        return kinetic_energy(mass_matrix(self.model, self.data), self.data.qvel)

    def momentum(self) -> np.ndarray:
        """P and L about the origin of the whole system."""
        mujoco.mj_subtreeVel(self.model, self.data)
        parts = []
        for tree in self.assembly.system.trees:
            body, data = tree.root, self.data
            parts.append(
                subtree_momenta(
                    self.model.body_subtreemass[body],
                    data.subtree_linvel[body],
                    data.subtree_com[body],
                    data.subtree_angmom[body],
                )
            )
        return np.sum(parts, axis=0)

    def run(self) -> Outcome:
        """Thirty seconds."""
        ticks, per_tick = self.assembly.scenario.ticks, round(PERIOD_S / self.step_s)
        command, touching, path = Command.off(int(self.model.nu)), False, []
        start = time.process_time()
        for tick in range(ticks + 1):
            self.decide(tick * PERIOD_S, command)
            path.append((tick * PERIOD_S, *tip_state(self.assembly.system, self.data)[0][:2], *self.data.qpos[6:8]))
            for sub in range(per_tick if tick < ticks else 0):
                if not self.contact_steps:
                    self.energy_before, self.work_J = self.energy(), 0.0
                before, touching = touching, self.step(tick * per_tick + sub)
                if touching and len(self.contact_steps) == 1:
                    self.decide(tick * PERIOD_S + (sub + 1) * self.step_s, command, touched=True)
                if before and not touching:
                    mujoco.mj_forward(self.model, self.data)
                    self.energy_change, self.impulse = (
                        self.energy() - self.work_J - self.energy_before,
                        -5.0 * self.data.qvel[6],
                    )
        return self.outcome(np.array(path), time.process_time() - start)

    def outcome(self, path: np.ndarray, cpu_s: float) -> Outcome:
        """What it came to."""
        momentum = self.momentum()
        return Outcome(
            self.recipe.name,
            self.step_s,
            float(self.contact_steps[0] + 1) * self.step_s,
            len(self.contact_steps),
            self.depth_m,
            float(self.impulse),
            self.energy_change / self.energy_before,
            float(np.linalg.norm(momentum[:3])),
            float(np.linalg.norm(momentum[3:])),
            path,
            cpu_s,
        )


def exact(step_s: float) -> tuple[Outcome, ImpactRecord]:
    """The same run with the impact resolved, and its record."""
    prepared = prepare("baseline", [f"time_step_s={step_s}"])
    start = time.process_time()
    run = prepared.run()
    spent = time.process_time() - start
    (hit,) = run.impacts
    names = ("state.time_s", "state.tip_x_m", "state.tip_y_m", "state.q_object_x_m", "state.q_object_y_m")
    outcome = Outcome(
        EXACT,
        step_s,
        hit.time_s,
        0,
        0.0,
        hit.impulse_N_s,
        hit.energy_change_J / hit.energy_before_J["total"][0],
        float(np.hypot(run["momentum.total_P_x_N_s"][-1], run["momentum.total_P_y_N_s"][-1])),
        abs(float(run["momentum.total_L_z_N_m_s"][-1])),
        np.column_stack([run[name] for name in names]),
        spent,
    )
    return outcome, hit


def away(outcome: Outcome, reference: Outcome, columns: slice) -> np.ndarray:
    """Distance from the reference at every tick, of the tip (1:3) or the object (3:5)."""
    return np.linalg.norm(outcome.path[:, columns] - reference.path[:, columns], axis=1)


def in_mm(length_m: float) -> str:
    """A distance in mm; below a nanometre it is rounding."""
    return "< 1e-6" if length_m < 1e-9 else small(1e3 * length_m, 2)


def results_table(outcomes: list[Outcome], reference: Outcome) -> str:
    """One row per run."""
    head = [
        *("settings", "step, ms", "contact at, s", "steps in it", "depth, mm", "impulse, N s", "dT/T"),
        *("P at 30 s, N s", "L at 30 s, N m s", "tip off, mm", "object off, mm", "CPU, s"),
    ]
    rows = (
        [
            o.recipe,
            f"{1e3 * o.step_s:g}",
            fixed(o.first_contact_s, 5),
            str(o.steps_in_contact),
            small(1e3 * o.depth_m) if o.depth_m else "0",
            fixed(o.impulse_N_s, 5),
            small(o.energy_error, 2),
            small(o.momentum_end_N_s),
            small(o.angular_momentum_end_N_m_s),
            in_mm(away(o, reference, slice(1, 3))[-1]),
            in_mm(away(o, reference, slice(3, 5))[-1]),
            f"{o.cpu_s:.1f}",
        ]
        for o in outcomes
    )
    return markdown_table(head, rows)


HEAD_ON = """<mujoco><option timestep="{step}" gravity="0 0 0" integrator="Euler"><flag speculative="{flag}"/></option>
<default><geom condim="1" solref="{stiffness} {damping}" solimp="0.995 0.995 0.001" mass="0"/></default><worldbody>
<body pos="-0.2847 0 0"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom size="0.001"/></body>
<body><freejoint/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""
HEAD_ON_STEPS_S = (1e-3, 5e-3, 2e-2)


@dataclass(frozen=True)
class HeadOn:
    """What a head-on impact came to: end of the step with the contact, dist in it, speed of the sphere, energy ratio."""

    contact_s: float
    distance_m: float
    sphere_m_s: float
    energy_ratio: float


def head_on(step_s: float, *, speculative: bool) -> HeadOn:
    """A sphere of 1 kg and 1 mm at 1 m/s hits a box of 2 kg at 0.1837 s; exact at e = 1: -1/3 m/s, all energy kept."""
    stiffness, damping = _dashpot(step_s)
    flag = "enable" if speculative else "disable"
    model = mujoco.MjModel.from_xml_string(HEAD_ON.format(step=step_s, flag=flag, stiffness=stiffness, damping=damping))
    data = mujoco.MjData(model)
    data.qvel[0], contact_s, distance_m = 1.0, math.nan, math.inf
    for _ in range(round(0.4 / step_s)):
        mujoco.mj_step(model, data)
        if data.ncon:
            contact_s = data.time if math.isnan(contact_s) else contact_s
            distance_m = min(distance_m, float(data.contact.dist.min()))
    energy_J = 0.5 * data.qvel[0] ** 2 + data.qvel[6] ** 2
    return HeadOn(contact_s, distance_m, float(data.qvel[0]), float(energy_J / 0.5))


def speculation_table() -> str:
    """The head-on impact with and without the flag."""
    head = ["step, ms", "speculative", "contact in the step to, s", "dist, mm", "speed after, m/s", "energy after / before"]
    rows = []
    for step in HEAD_ON_STEPS_S:
        for speculative in (False, True):
            hit = head_on(step, speculative=speculative)
            cells = [fixed(hit.contact_s, 4), fixed(1e3 * hit.distance_m, 3), fixed(hit.sphere_m_s, 5)]
            rows.append([f"{1e3 * step:g}", "on" if speculative else "off", *cells, fixed(hit.energy_ratio, 5)])
    return markdown_table(head, rows)


def draw(outcomes: list[Outcome], reference: Outcome, path: Path) -> None:
    """How far tip and object are from where the exact impact sends them, at the largest and the smallest step."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    colours = dict(
        zip((r.name for r in RECIPES), ("#0072B2", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#E69F00"), strict=True)
    )
    with mpl.rc_context(
        {
            "font.size": 8.5,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "grid.color": "#D5D5D5",
            "grid.linewidth": 0.5,
            "legend.frameon": False,
            "axes.axisbelow": True,
        }
    ):
        figure = Figure(figsize=(7.0, 3.4), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, columns, title in zip(panels, (slice(1, 3), slice(3, 5)), ("tip", "object"), strict=True):
            for o in outcomes:
                if o.recipe == EXACT or o.step_s not in (STEPS_S[0], STEPS_S[-1]):
                    continue
                coarse = o.step_s == STEPS_S[0]
                label = f"{o.recipe}, {1e3 * o.step_s:g} ms"
                style = {"linestyle": "-" if coarse else (0, (4, 1.5)), "linewidth": 1.2}
                axes.semilogy(
                    o.path[::20, 0], away(o, reference, columns)[::20], color=colours[o.recipe], label=label, **style
                )
            axes.set_title(title, fontsize=9)
            axes.set_xlim(7.0, 30.0)
            axes.set_ylim(1e-6, 10.0)
            axes.set_xlabel("time, s")
        panels[0].set_ylabel("distance from the exact run, m")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=7.5)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=160, metadata={"Software": None})


PAGE = Path(__file__).with_suffix(".md")


def main() -> None:
    """Run everything, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dry", action="store_true", help="only print the table")
    dry = parser.parse_args().dry
    runs = [exact(step) for step in STEPS_S]
    outcomes = [outcome for outcome, _ in runs]
    outcomes += [
        SoftRun(recipe, step, hit).run() for recipe in RECIPES for step, (_, hit) in zip(STEPS_S, runs, strict=True)
    ]
    reference = outcomes[len(STEPS_S) - 1]
    text = results_table(outcomes, reference)
    speculation = speculation_table()
    print(text, speculation, sep="\n\n")
    if not dry:
        (DOCS / "soft-contact.md").write_text(
            Template(PAGE.read_text(encoding="utf-8")).substitute(
                table=text, spring_steps=SPRING_STEPS, speculation=speculation
            ),
            encoding="utf-8",
        )
        draw(outcomes, reference, DOCS / "figures" / "soft-contact.png")


if __name__ == "__main__":
    main()
