"""What is run: engines, settings with the page that documents them, and the values that are swept."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from engine_runs import (
    with_basilisk,
    with_bullet,
    with_drake,
    with_exudyn,
    with_ffsm,
    with_mujoco,
    with_newton,
    with_ode,
    with_pinocchio,
    with_siconos,
)
from engine_runs.scene import Scene, collision, free_flight, grip, weld
from engine_runs.states import States

Result = tuple[list[States], float]
OURS = "ffsm-mj"


@dataclass(frozen=True)
class Job:
    """One run: a setting at one value of what is swept."""

    engine: str
    setting: str
    scene: Scene
    value: str
    run: Callable[[], Result]


def _ms(step_s: float) -> str:
    return f"{1e3 * step_s:g} ms"


def ours() -> Iterator[Job]:
    """ffsm-mj."""
    steps: list[tuple[Scene, tuple[float, ...]]] = [
        (collision(1.0), (0.1, 0.01, 0.001)),
        (collision(0.5), (0.1, 0.01, 0.001)),
        (grip(), (0.02, 0.005)),
        (free_flight(), (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)),
        (weld(), (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)),
    ]
    for scene, sweep in steps:
        for h in sweep:
            yield Job(OURS, "compiled", scene, _ms(h), lambda s=scene, h=h: with_ffsm.run(s, h))


def mujoco() -> Iterator[Job]:
    """MuJoCo."""

    def job(setting: str, scene: Scene, value: str, recipe: with_mujoco.Recipe, h: float) -> Job:
        return Job("MuJoCo", setting, scene, value, lambda: with_mujoco.run(scene, recipe, h))

    steps = (0.01, 0.004, 0.002, 0.001, 0.0004, 0.0001)
    for e in (1.0, 0.5):
        scene = collision(e)
        for h in steps:
            yield job("spring, RK4", scene, _ms(h), with_mujoco.spring(h, e), h)
            yield job("dashpot, Euler", scene, _ms(h), with_mujoco.dashpot(h, e), h)
        yield job("default contact, RK4", scene, _ms(0.001), with_mujoco.default_contact(), 0.001)
    for ratio in (1, 10, 100, 1000):
        for integrator in ("RK4", "implicitfast"):
            recipe = with_mujoco.elliptic(ratio, integrator)
            yield job(f"elliptic cone, impratio, {integrator}", grip(), f"impratio {ratio}", recipe, 0.001)
    recipe = with_mujoco.no_slip(10)
    yield job("elliptic cone, impratio 10, noslip, implicitfast", grip(), "10 iterations", recipe, 0.001)
    for h in (0.05, 0.02, *steps[:-1]):
        yield job("RK4", free_flight(), _ms(h), with_mujoco.free("RK4"), h)
        yield job("implicitfast", free_flight(), _ms(h), with_mujoco.free("implicitfast"), h)
        yield job("weld, time constant 2 h, RK4", weld(), _ms(h), with_mujoco.welded(h, "RK4"), h)
    for h in (0.01, 0.001):
        yield job("weld, defaults, RK4", weld(), _ms(h), with_mujoco.default_weld("RK4"), h)
        yield job("weld, time constant 2 h, implicitfast", weld(), _ms(h), with_mujoco.welded(h, "implicitfast"), h)


def hunt_crossley(restitution: float, speed_m_s: float) -> float:
    """Dissipation d in s/m of Drake's model that gives a restitution at one approach speed v.

    Work of k x (1 + d xdot) along a collision: ln((1 + d v) / (1 - d e v)) = d v (1 + e).
    """
    from scipy.optimize import brentq

    def excess(dv: float) -> float:
        return math.log((1.0 + dv) / (1.0 - restitution * dv)) - dv * (1.0 + restitution)

    return 0.0 if restitution == 1.0 else float(brentq(excess, 0.1, 0.999 / restitution)) / speed_m_s


def drake() -> Iterator[Job]:
    """Drake."""
    recipe = with_drake.Recipe

    def job(setting: str, scene: Scene, value: str, recipe: with_drake.Recipe) -> Job:
        return Job("Drake", setting, scene, value, lambda: with_drake.run(scene, recipe))

    for e in (1.0, 0.5):
        scene, d = collision(e), hunt_crossley(e, 1.0)
        for k in (1e6, 1e8, 1e10, 1e12):
            exact = recipe("runge_kutta3", 0.1, 1e-8, k, d)
            yield job("point contact, RK3 with error control", scene, f"{k:.0e} N/m", exact)
        for h in (0.01, 0.001, 0.0001):
            yield job("point contact, CENIC", scene, f"at most {_ms(h)}", recipe("cenic", h, 1e-5, 1e6, d))
            yield job("point contact, SAP", scene, _ms(h), recipe("sap", h, None, 1e6, d))
    pressed: dict[str, Any] = {"stiffness_N_m": 1e6, "dissipation": 1.0, "hydroelastic_Pa": 1e7}
    for speed in (1e-4, 1e-6, 1e-8):
        creep, value = pressed | {"stiction_m_s": speed}, f"stiction tolerance {speed:g} m/s"
        yield job("hydroelastic, TAMSI", grip(), value, recipe("tamsi", 1e-3, **creep))
        yield job("hydroelastic, Lagged", grip(), value, recipe("lagged", 1e-3, **creep))
    for h in (0.01, 0.001):
        yield job("hydroelastic, SAP", grip(), _ms(h), recipe("sap", h, **pressed))
    for accuracy in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        value = f"accuracy {accuracy:g}"
        yield job("RK5 with error control", free_flight(), value, recipe("runge_kutta5", 0.2, accuracy))
        yield job("RK3 with error control", free_flight(), value, recipe("runge_kutta3", 0.2, accuracy))
    for h in (0.01, 0.001):
        yield job("discrete (SAP)", free_flight(), _ms(h), recipe("sap", h))
    for h in (0.02, 0.01, 0.004, 0.001):
        yield job("weld constraint, SAP", weld(), _ms(h), recipe("sap", h))


def bullet() -> Iterator[Job]:
    """Bullet."""

    def job(setting: str, scene: Scene, h: float, recipe: with_bullet.Recipe) -> Job:
        return Job("Bullet", setting, scene, _ms(h), lambda: with_bullet.run(scene, recipe, h))

    clean = with_bullet.Recipe(
        {"restitutionVelocityThreshold": 0.0, "erp": 0.0, "contactERP": 0.0}, {"contactProcessingThreshold": 0.0}
    )
    many = with_bullet.Recipe({"numSolverIterations": 500, "solverResidualThreshold": 0.0})
    for e in (1.0, 0.5):
        for h in (0.01, 0.004, 0.001, 0.0004, 0.0001):
            yield job("restitution, no error correction", collision(e), h, clean)
        yield job("restitution, defaults", collision(e), 0.001, with_bullet.Recipe())
    for h in (0.005, 0.001, 0.0002):
        yield job("500 iterations", grip(), h, many)
    yield job("friction anchors", grip(), 0.001, with_bullet.Recipe({}, {"frictionAnchor": 1}))
    for h in (0.01, 0.004, 0.001, 0.0001):
        yield job("reduced coordinates", free_flight(), h, with_bullet.Recipe())
        yield job("fixed constraint", weld(), h, with_bullet.Recipe())


def ode() -> Iterator[Job]:
    """ODE."""

    def job(setting: str, scene: Scene, value: str, h: float, recipe: with_ode.Recipe) -> Job:
        return Job("ODE", setting, scene, value, partial(with_ode.run, scene, recipe, h))

    for h in (0.01, 0.004, 0.001, 0.0004, 0.0001):
        for e in (1.0, 0.5):
            yield job("bounce", collision(e), _ms(h), h, with_ode.Recipe())
        yield job("hinges", free_flight(), _ms(h), h, with_ode.Recipe())
        yield job("fixed joint", weld(), _ms(h), h, with_ode.Recipe())
    for cfm in (1e-5, 1e-7, 1e-9):
        yield job("friction pyramid, CFM", grip(), f"CFM {cfm:g}", 0.01, with_ode.Recipe(cfm=cfm))


def pinocchio() -> Iterator[Job]:
    """Pinocchio."""
    sweeps: list[tuple[str, Scene]] = [
        ("impulseDynamics, bisection in Python", collision(1.0)),
        ("impulseDynamics, bisection in Python", collision(0.5)),
        ("aba, RK4 in Python", free_flight()),
        ("constraintDynamics, RK4 in Python", weld()),
    ]
    for setting, scene in sweeps:
        for h in (0.05, 0.02, 0.01, 0.005):
            yield Job("Pinocchio", setting, scene, _ms(h), lambda s=scene, h=h: with_pinocchio.run(s, h))


def basilisk() -> Iterator[Job]:
    """Basilisk."""

    def job(setting: str, scene: Scene, h: float, recipe: with_mujoco.Recipe, *, high_order: bool) -> Job:
        run = partial(with_basilisk.run, scene, recipe, h, high_order=high_order)
        return Job("Basilisk", setting, scene, _ms(h), run)

    for h in (0.05, 0.02, 0.01, 0.004, 0.001):
        yield job("RK4, highOrderAttitudeIntegration", free_flight(), h, with_mujoco.free("RK4"), high_order=True)
        yield job("RK4, defaults", free_flight(), h, with_mujoco.free("RK4"), high_order=False)
        weld_of_mujoco = with_mujoco.welded(h, "RK4")
        yield job("weld of MuJoCo, highOrderAttitudeIntegration", weld(), h, weld_of_mujoco, high_order=True)


def newton() -> Iterator[Job]:
    """Newton."""
    recipe = with_newton.Recipe
    implicit = {"lox.contact_implicit_restitution": True}
    loose = {"iterations": 10, "rigid_contact_con_weighting": False}
    plans: list[tuple[str, with_newton.Recipe, Scene, tuple[float, ...]]] = []
    for e in (1.0, 0.5):
        plans += [
            ("XPBD, enable_restitution", recipe("xpbd", 0.01, {"enable_restitution": True}), collision(e), FINE),
            ("Kamino LOX, implicit restitution", recipe("lox", 0.02, implicit), collision(e), COARSE),
            ("Kamino PADMM", recipe("padmm", 0.01), collision(e), COARSE),
        ]
    plans += [
        ("Kamino PADMM", recipe("padmm", 0.01), grip(), (0.01, 0.005)),
        ("Kamino LOX", recipe("lox", 0.01), grip(), (0.01,)),
        ("XPBD, without contact weighting", recipe("xpbd", 0.01, loose), grip(), (0.01, 0.005)),
    ]
    for scene, name in ((free_flight(), ""), (weld(), ", fixed joint")):
        plans += [
            (f"Kamino PADMM{name}", recipe("padmm", 0.0), scene, (0.01, 0.004, 0.002)),
            (f"Kamino LOX{name}", recipe("lox", 0.0), scene, (0.01, 0.005)),
            (f"XPBD{name}", recipe("xpbd", 0.0, {"iterations": 10}), scene, (0.01, 0.005)),
        ]
    plans.append(("Featherstone", recipe("featherstone"), free_flight(), (0.01, 0.004, 0.001)))
    for setting, how, scene, steps in plans:
        for h in steps:
            yield Job("Newton", setting, scene, _ms(h), lambda s=scene, r=how, h=h: with_newton.run(s, r, h))


FINE, COARSE = (0.01, 0.005, 0.002, 0.001), (0.01, 0.005, 0.002)


def siconos() -> Iterator[Job]:
    """Siconos."""
    for e in (1.0, 0.5):
        for h in (0.01, 0.004, 0.001, 0.0004, 0.0001):
            run = partial(with_siconos.run, collision(e), h)
            yield Job("Siconos", "Moreau-Jean, Newton impact law", collision(e), _ms(h), run)


def exudyn() -> Iterator[Job]:
    """Exudyn; of contacts that last 22 steps of explicit ones, and of the stiffest that its error control still meets."""

    def job(setting: str, scene: Scene, value: str, recipe: with_exudyn.Recipe, h: float) -> Job:
        return Job("Exudyn", setting, scene, value, lambda: with_exudyn.run(scene, recipe, h))

    recipe, lie = with_exudyn.Recipe, "RotationRotationVector"
    for e in (1.0, 0.5):
        for k in (1e6, 1e7, 1e8):
            adaptive = recipe("DOPRI5", lie, stiffness_N_m=k)
            yield job("restitution, DOPRI5 with error control", collision(e), f"{k:.0e} N/m", adaptive, 0.1)
        for h in (0.001, 0.0001, 0.00001):
            fixed = recipe("RK44", lie, stiffness_N_m=0.01 / h**2)
            yield job("restitution, RK44", collision(e), _ms(h), fixed, h)
    for zone in (1e-3, 1e-4, 1e-5, 1e-6):
        value = f"proportional below {zone:g} m/s"
        yield job("spheres for pads, trapezoidal rule", grip(), value, recipe(zone_m_s=zone), 0.01)
    for h in (0.05, 0.02, 0.01, 0.004, 0.001):
        yield job("joints as constraints, trapezoidal rule", free_flight(), _ms(h), recipe(), h)
        yield job("rigid joint, trapezoidal rule", weld(), _ms(h), recipe(), h)
    for accuracy in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        run = partial(with_exudyn.run_tree, free_flight(), recipe("DOPRI5", accuracy=accuracy), 0.5)
        yield Job("Exudyn", "tree, DOPRI5 with error control", free_flight(), f"accuracy {accuracy:g}", run)


def of_distribution(name: str) -> Callable[[], str | None]:
    """What tells the version of a distribution; None: not installed."""

    def found() -> str | None:
        try:
            return version(name)
        except PackageNotFoundError:
            return None

    return found


ENGINES: dict[str, tuple[Callable[[], str | None], Callable[[], Iterator[Job]]]] = {
    OURS: (of_distribution("ffsm-mj"), ours),
    "MuJoCo": (of_distribution("mujoco"), mujoco),
    "Newton": (of_distribution("newton"), newton),
    "Drake": (of_distribution("drake"), drake),
    "Bullet": (of_distribution("pybullet"), bullet),
    "ODE": (of_distribution("Py3ODE"), ode),
    "Siconos": (with_siconos.version, siconos),
    "Exudyn": (of_distribution("exudyn"), exudyn),
    "Pinocchio": (of_distribution("pin"), pinocchio),
    "Basilisk": (of_distribution("bsk"), basilisk),
}
"""By name: version, jobs."""
