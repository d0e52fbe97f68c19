"""Description of an assembled scenario as lines of text, its scene at t = 0, and notes on what to know before it runs.

Closed loops of grasps are considered at the initial state, where several of one object are closed together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_controllers.parts import Parts
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.contact_rules import ContactRule, Contacts
from ffsm_mj.assembly.control_laws import undriven_actuators
from ffsm_mj.assembly.grasps import grasps_of
from ffsm_mj.assembly.orbit_notes import orbit_lines, orbit_notes
from ffsm_mj.assembly.plant import rounded_down, spring_lines
from ffsm_mj.assembly.union_notes import union_lines, union_notes
from ffsm_mj.contact.cone_pair import ConePair
from ffsm_mj.contact.joint_limit import JointLimit
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.grasp.loops import closing_pose, loop_latch
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.contact_models.grasp.records import NEARLY_SINGULAR
from ffsm_mj.contact_models.impact.records import force_unit
from ffsm_mj.contact_models.joint_friction.coordinates import friction_coordinates
from ffsm_mj.controller_protocol import Controller, Damps, IntArray
from ffsm_mj.dynamics.loops.closed_loops import ClosedLoops
from ffsm_mj.dynamics.loops.equalities import ConstrainedModel, equalities_of
from ffsm_mj.dynamics.reach import Reach, reach_of
from ffsm_mj.dynamics.stiff_actuators import StiffActuators
from ffsm_mj.errors import described, first_few, plural
from ffsm_mj.hull import hull_offset
from ffsm_mj.log.drawing import CheckedPair, InitialScene, NamedPoint
from ffsm_mj.model.actuators import servo_mask
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.inputs import further_inputs
from ffsm_mj.model.system import System, rotors, shared_joints
from ffsm_mj.records.metadata import gravity_line, gravity_metadata
from ffsm_mj.scenario.loading import never_armed
from ffsm_mj.scenario.phases import graph_lines, is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig
from ffsm_mj.sensing.sensor import Sensor
from ffsm_mj.tolerances import MECHANISM_RANK

_SHOWN_M = 1e-4
"""Meshes whose convex hull is closer than this are not mentioned."""


def rule_lines(contacts: Contacts) -> Iterator[str]:
    """One line per contact rule, with the number of pairs that it has."""
    if not contacts.rules:
        yield "contacts: none"
        return
    default = ": one rule for each pair of models (default)" if contacts.is_default else ""
    yield f"contacts{default}"
    for rule in contacts.rules:
        yield f"  {_sentence(rule, contacts)}"


def _sentence(rule: ContactRule, contacts: Contacts) -> str:
    friction = f", mu = {rule.mu:g}" if rule.mu else ""
    friction += f", k_t / k_n = {1.0 / rule.compliance_ratio:.4g}" if rule.compliance_ratio else ""
    count = len(rule.geoms)
    pairs = [pair for pair in contacts.pairs if pair.rule == rule.name]
    which = f"{pairs[0]}" if count == 1 and pairs else plural(count, "pair")
    lost = rule.matched - count
    left = f" ({lost} more ignored or in later rules)" if lost else ""
    return f"{rule.name}: e = {rule.restitution:g}{friction}, {which}{left}"


def cone_lines(contacts: Contacts, system: System) -> Iterator[str]:
    """A heading and one line for each cone, with the geoms that may touch it; none without any."""
    if system.cones:
        yield "cones, inner surfaces"
    for geom, cone in system.cones.items():
        name, angle = system.mj.geom(geom).name, f"half angle {cone.half_angle_deg:g} deg"
        extent = f"from {cone.from_m:g} to {cone.length_m:g} m from the apex"
        inside = len({pair.geom_ids for pair in contacts.pairs if geom in pair.geom_ids})
        met = f"{plural(inside, 'geom')} may touch it" if inside else "nothing touches it: no contact rule has it"
        yield f"  {name}: {angle}, {extent}, mouth of radius {cone.mouth_radius_m:.4g} m; {met}"


def contact_notes(contacts: Contacts, system: System) -> Iterator[str]:
    """Notes on contacts that are reported instead of resolved, and on those that end the run."""
    yield from _filtered(contacts, system)
    yield from _left_out(contacts, system)
    reasons = Counter(contacts.unsupported.values())
    for reason, count in reasons.items():
        yield f"the run ends where {'one of ' * (count > 1)}{plural(count, 'pair')} meets: {reason}"


def _filtered(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on models that pass through each other."""
    geoms = {model.name: np.isin(system.mj.geom_bodyid, model.bodies).any() for model in system.models}
    for pair in contacts.filtered:
        bare = " and ".join(f"{name!r}" for name in pair if not geoms[name])
        why = f"{bare} without geoms" if bare else "contype and conaffinity in their models exclude every pair of geoms"
        yield f"{pair[0]!r} and {pair[1]!r} cannot touch: {why}"


def _left_out(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on contacts that could occur and that no rule resolves, by pairs of models."""
    number = {body: i for i, model in enumerate(system.models) for body in model.bodies}
    counts = Counter(tuple(sorted(number[int(system.mj.geom_bodyid[geom])] for geom in pair)) for pair in contacts.left_out)
    names = [model.name for model in system.models]
    if counts:
        pairs = [f"{names[a]} with {'itself' if a == b else names[b]} ({count})" for (a, b), count in sorted(counts.items())]
        which = first_few(pairs)
        yield f"overlaps of other pairs are reported, not resolved (contacts.rules, contacts.ignored): {which}"


def mesh_notes(contacts: Contacts, system: System) -> Iterator[str]:
    """A note on meshes in contacts that collide as their convex hulls; takes up to a second for a large mesh."""
    model = system.mj
    geoms = sorted({geom for pair in contacts.pairs for geom in pair.geom_ids} - {*system.pieces, *system.cones})
    depths = [(hull_offset(model, geom), system.mj.geom(geom).name) for geom in geoms]
    offsets = sorted(((offset, name) for offset, name in depths if offset > _SHOWN_M), reverse=True)
    apart = [f"{name} {1e3 * offset:.3g} mm" for offset, name in offsets]
    if apart:
        yield f"meshes collide as their convex hulls, at least this far off their triangles (decompose): {first_few(apart)}"


def piece_lines(system: System) -> list[str]:
    """A heading and a line for each decomposed mesh; none if there are none."""
    lines = [
        f"    {name}/{mesh}: {pieces.sentence}"
        for name, files in system.files.items()
        for mesh, pieces in files.pieces.items()
    ]
    return ["  meshes as convex pieces", *lines] if lines else []


def _unwatched_overlaps(assembly: Assembly) -> Iterator[str]:
    """A note on geoms that overlap initially, whose contacts are neither resolved nor ignored."""
    watch = ContactWatch(assembly.system.mj, assembly.data, assembly.known_pairs, filtered=assembly.contacts.left_out)
    watch.look(0.0)
    overlaps = [" and ".join(record.geoms) for record in watch.finish(0.0)]
    if overlaps:
        yield f"these overlap at the start, and no contact force will separate them: {first_few(overlaps)}"


def _disarmed_pairs(assembly: Assembly) -> Iterator[str]:
    """Pairs with a contact rule of one rigid body while a rigid grasp is closed: no note, nothing is lost by it."""
    for contact_model in assembly.plant.integrator.sources:
        if isinstance(contact_model, GraspModel):
            for name, pairs in contact_model.disarmed.items():
                # A cone has a pair for each place of a geom.
                named = {pair.geom_ids: pair for pair in reversed(assembly.pairs) if pair.geom_ids in pairs}
                names = [pair.shared_name if isinstance(pair, ConePair) else pair.name for pair in reversed(named.values())]
                if names:
                    yield f"    while {name!r} is closed, on one rigid body: {first_few(names)}"


_NEAR = 1e-4
"""Least singular value over the largest below which it is noted; of 62 public robots the least is 8.5e-4."""


def loop_lines(assembly: Assembly) -> list[str]:
    """A heading, a line for equality constraints, and one for each object with grasps of several sites; none without any."""
    lines = _mechanism_lines(assembly)
    for grasps in _together(assembly):
        loops = _loops(assembly, grasps)
        rows, rank = loops.count, loops.weighted().rank
        names = " and ".join(grasp.name for grasp in grasps)
        lines.append(
            f"    {names}: {grasps[0].tree}, {rows} stopped motions of rank {rank}, mobility {assembly.system.mj.nv - rank}"
        )
    return ["  closed loops, at the initial state", *lines] if lines else []


def _mechanism_lines(assembly: Assembly) -> list[str]:
    """A line on the equality constraints of the models; none without any."""
    loops = _equalities(assembly)
    if loops is None:
        return []
    rank, nv = loops.weighted().rank, assembly.system.mj.nv
    return [
        f"    {plural(len(loops.sources), 'equality constraint')}: {loops.count} rows of rank {rank}, mobility {nv - rank}"
    ]


def _equalities(assembly: Assembly) -> ClosedLoops | None:
    system = assembly.system
    sources = [equality.source for equality in equalities_of(system.mj)]
    return ClosedLoops(system.mj, assembly.data, sources, rank=MECHANISM_RANK) if sources else None


def loop_notes(assembly: Assembly) -> Iterator[str]:
    """Loads that the joints do not determine, and mechanisms that are nearly singular."""
    equalities = _equalities(assembly)
    if equalities is not None and (ratio := equalities.weighted().least_ratio) < _NEAR:
        yield (
            f"the equality constraints are nearly singular at the initial state: least singular value {ratio:.1e} of the "
            "largest; forces are large"
        )
    for grasps in _together(assembly):
        loops = _loops(assembly, grasps)
        names, weighted = " and ".join(grasp.name for grasp in grasps), loops.weighted()
        if weighted.rank < loops.count:
            yield f"with {names} closed, the joints do not determine all loads: those of least norm are logged"
        if weighted.least_ratio < NEARLY_SINGULAR:
            yield (
                f"with {names} closed at the initial state, the mechanism is nearly singular: "
                f"least singular value {weighted.least_ratio:.1e} of the largest; loads are large"
            )


def friction_notes(assembly: Assembly) -> Iterator[str]:
    """Loads that dry friction leaves undetermined: where contacts or limits may press a joint that sticks as well."""
    on = friction_coordinates(assembly.system)
    if on is None:
        return
    stops = any(limit.joint in on.names and limit.restitution < 1.0 for limit in assembly.limits)
    if stops or any(pair.restitution < 1.0 for pair in assembly.contacts.pairs):
        yield (
            "where contacts or limits block a joint that its dry friction would hold as well, normal forces are not "
            "determined; by the convention idle_friction the friction is idle, and contacts and limits carry what they can"
        )


def _together(assembly: Assembly) -> list[list[Grasp]]:
    """Grasps of one object by different sites, the first one of the same two sites each."""
    by_object: dict[str, list[Grasp]] = {}
    for grasp in grasps_of(assembly.scenario, assembly.system):
        others = by_object.setdefault(grasp.tree, [])
        if not any(grasp.joins_sites_of(other) for other in others):
            others.append(grasp)
    return [grasps for grasps in by_object.values() if len(grasps) > 1]


def _loops(assembly: Assembly, grasps: list[Grasp]) -> ClosedLoops:
    """All of them as rows, with the bodies where they are at the initial state."""
    system, data = assembly.system, assembly.data
    latches = [loop_latch(system, grasp, closing_pose(system, data, grasp)) for grasp in grasps]
    return ClosedLoops(system.mj, data, latches)


# An effort -K qdot held for a period dt maps qdot to (1 - dt M_c^-1 K) qdot; position gains do not change this limit.
_LIMIT = 2.0


class _Damping(NamedTuple):
    """Damping of all laws of a phase: key and gain of each dof, dofs of the model, and the matrix, block by block."""

    keys: list[str]
    dofs: IntArray
    gains: FloatArray
    matrix: FloatArray


def unstable_damping(assembly: Assembly) -> Iterator[str]:
    """Messages for phases with unstable damping, with all degrees of freedom that the law does not damp left free.

    Args:
        assembly: Parts of one run, at the initial state.
    """
    for phase in assembly.controller.phases:
        try:
            damping = _damping(phase.controller, assembly.controller_data)
            message = _instability(assembly, damping) if damping else ""
        except Exception as error:  # noqa: BLE001 (a plugin's code: whatever it raises is no reason to refuse the scenario)
            message = f"its damping cannot be computed ({described(error)})"
        if message:
            yield f"phase {phase.name!r} ({phase.kind}): {message}"


def _damping(law: Controller, data: Any) -> _Damping | None:
    """Damping of a law or of all parts of a phase; None without any."""
    laws = {f"{part.name}.": part.law for part in law.parts} if isinstance(law, Parts) else {"": law}
    optional = {prefix: controller.damping_at(data) for prefix, controller in laws.items() if isinstance(controller, Damps)}
    dampings = {prefix: damping for prefix, damping in optional.items() if damping is not None}
    if not dampings:
        return None
    matrix = np.zeros((sum(len(one.dofs) for one in dampings.values()),) * 2)
    keys: list[str] = []
    for prefix, one in dampings.items():
        block = slice(len(keys), len(keys) + len(one.dofs))
        matrix[block, block] = one.matrix
        keys += [prefix + one.key] * len(one.dofs)
    dofs, gains = (np.concatenate([getattr(one, name) for one in dampings.values()]) for name in ("dofs", "gains"))
    return _Damping(keys, dofs, gains, matrix)


def _instability(assembly: Assembly, damping: _Damping) -> str:
    """Message for an unstable damping; empty if it is stable."""
    system, data, period = assembly.system, assembly.data, assembly.scenario.control_period_s
    dofs = damping.dofs
    if assembly.compiled.controller_system is not None:  # a law may not know all joints of the plant
        in_controller, its = shared_joints(assembly.compiled.controller_system, system).dofs
        dofs = its[np.argsort(in_controller)][dofs]
    # This part of M^-1 is the inverse of M_c, the mass matrix of these dofs with all others floating.
    answers = np.empty((len(dofs), system.mj.nv))
    ConstrainedModel(system.mj).respond(data, np.eye(system.mj.nv)[dofs], answers)
    mobility = answers[:, dofs]
    values, vectors = np.linalg.eig(period * mobility @ damping.matrix)
    worst = int(np.argmax(values.real))
    eigenvalue = float(values.real[worst])
    if eigenvalue <= _LIMIT:
        return ""
    motion = vectors[:, worst]
    dof = int(np.argmax(np.abs(motion.conj() * (damping.matrix @ motion))))  # by power: rad/s and m/s compare
    joint = next(joint.name for joint in system.joints.values() if joint.dofs.start <= dofs[dof] < joint.dofs.stop)
    gain = float(damping.gains[dof])
    key = damping.keys[dof]
    alike = "" if np.all(damping.gains == gain) else ", with the others in proportion"
    return (
        f"{key} is unstable at the control period of {period:g} s: dt M_c^-1 K_d has the eigenvalue "
        f"{eigenvalue:.3g} (stable up to {_LIMIT:g}), mostly of joint {joint!r}; {key} = {gain:g} there is stable "
        f"up to {rounded_down(gain * _LIMIT / eigenvalue):g}{alike}"
    )


_TURN = 2.0 * np.pi
_ROUNDED_M = 1e-5
"""Rounding of a target that was read off a model, m: templates write six decimals."""


def initial_scene(assembly: Assembly, lines: list[str]) -> InitialScene:
    """The scene of an assembly, for a viewer.

    Args:
        assembly: Components of a run at t = 0.
        lines: Text shown beside the scene.
    """
    system = assembly.system
    pairs = [
        CheckedPair(
            *(pair.name, pair.ids, pair.restitution, pair.mu),
            nearest=pair.nearest_points(assembly.data) if isinstance(pair, ConePair) else None,
        )
        for pair in assembly.pairs
    ]
    resolved = {frozenset(pair.geoms) for pair in pairs}
    return InitialScene(
        name=assembly.scenario.name,
        system=system,
        data=assembly.data,
        targets=list(_targets(assembly)),
        centres=list(_centres(system, assembly.data)),
        reaches=_reaches(assembly),
        pairs=pairs,
        ignored=assembly.known_pairs - resolved,
        lines=lines,
        view=assembly.scenario.view,
    )


def initial_lines(assembly: Assembly) -> list[str]:
    """Poses of sites, targets and centres of mass at t = 0, one line each, in world axes; and the reach of the arm."""
    system, data = assembly.system, assembly.data
    tips = _tips(assembly)
    sites = [
        (f"{'tip ' if site in tips else ''}{system.mj.site(site).name}", data.site_xpos[site], _quaternion(data, site))
        for site in sorted(range(system.mj.nsite), key=lambda site: site not in tips)
    ]
    points = [(point.name, point.point_m, "") for point in (*_targets(assembly), *_centres(system, data))]
    return [
        *(["  sites at t = 0, world axes: x y z in m, quaternion w x y z", *_aligned(sites)] if sites else []),
        "  points at t = 0, world axes: x y z in m",
        *_aligned(points),
        *(f"  {_reach_line(reach)}" for reach in _reaches(assembly)),
    ]


def _aligned(rows: Sequence[tuple[str, FloatArray, str]]) -> list[str]:
    width = max((len(name) for name, *_ in rows), default=0)
    return [f"    {name:<{width}}  {_numbers(point, '8.4f')}  {turn}".rstrip() for name, point, turn in rows]


def initial_notes(assembly: Assembly) -> Iterator[str]:
    """Initial values that are probably mistakes: hinges beyond one turn, a target beyond the reach of the arm."""
    # A wheel that turns without limits may have turned often, in a state of a log too: no angle of it is a mistake.
    wheels = {joint.name for joint in rotors(assembly.system)}
    angles = {name: float(assembly.data.qpos[joint.qpos][0]) for name, joint in assembly.system.joints.items()}
    turned = [
        f"{name} at {angle:g} rad ({angle:g} degrees are {np.deg2rad(angle):.6g} rad)"
        for name, angle in angles.items()
        if assembly.system.joints[name].kind == "hinge" and name not in wheels and abs(angle) > _TURN
    ]
    if turned:
        yield f"angles are in rad, and beyond one turn at the start: {first_few(turned)}"
    task = assembly.task
    if task is not None:
        yield from _beyond_reach(assembly, task.tip_site, "the target", task.target_m, list(task.axes))
    first = assembly.scenario.phases[0]
    for law in first.laws.values():
        followed, follows = getattr(law, "object_site", None), getattr(law, "robot_site", None)
        if followed is not None and follows is not None:
            tip, point = assembly.system.index("site", follows), _followed_point(assembly, law)
            yield from _beyond_reach(assembly, tip, f"the target of {first.name}", point, [0, 1, 2])


def _beyond_reach(assembly: Assembly, tip: int, what: str, point: FloatArray, axes: list[int]) -> Iterator[str]:
    reach = reach_of(assembly.system, assembly.data, tip)
    if reach is None:
        return
    distance = float(np.linalg.norm(point - reach.centre_m[axes]))
    if distance > reach.radius_m + _ROUNDED_M:
        yield (
            f"{what} is {distance:.4g} m from joint {reach.joint}, beyond the arm's reach of {reach.radius_m:.4g} m: "
            "the tip arrives only if the base moves"
        )


def _followed_point(assembly: Assembly, law: Any) -> FloatArray:
    """Where a law that follows a site of an object is to bring its own at t = 0, world axes, m, (3,)."""
    data, site = assembly.data, assembly.system.index("site", law.object_site)
    offset = data.site_xmat[site].reshape(3, 3) @ np.array(getattr(law, "offset_m", (0.0, 0.0, 0.0)))
    return np.asarray(data.site_xpos[site] + offset)


def _reach_line(reach: Reach) -> str:
    if not np.isfinite(reach.radius_m):
        return f"reach of {reach.tip}: unbounded, a slide joint after {reach.joint} has no limits"
    at = _numbers(reach.centre_m, ".4f")
    return (
        f"reach of {reach.tip}: at most {reach.radius_m:.4f} m from joint {reach.joint} at {at}, joint limits not considered"
    )


def _tips(assembly: Assembly) -> list[int]:
    """Ids of the sites of the robot that the task or a phase moves."""
    task = [] if assembly.task is None else [assembly.task.tip_site]
    laws = [law for phase in assembly.scenario.phases for law in phase.laws.values()]
    names = [getattr(law, "robot_site", None) for law in laws]
    return list(dict.fromkeys([*task, *(assembly.system.index("site", name) for name in names if name is not None)]))


def _reaches(assembly: Assembly) -> list[Reach]:
    reaches = (reach_of(assembly.system, assembly.data, site) for site in _tips(assembly))
    return [reach for reach in reaches if reach is not None]


def _targets(assembly: Assembly) -> Iterator[NamedPoint]:
    """Target of the task, at the height of the tip along axes that are not regulated, and sites that phases follow."""
    data, task = assembly.data, assembly.task
    if task is not None:
        point = data.site_xpos[task.tip_site].copy()
        point[list(task.axes)] = task.target_m
        yield NamedPoint("target of the tip", point)
    for phase in assembly.scenario.phases:
        for law in phase.laws.values():
            if getattr(law, "object_site", None) is not None:
                yield NamedPoint(f"target of {phase.name}", _followed_point(assembly, law))


def _centres(system: System, data: Any) -> Iterator[NamedPoint]:
    """Centres of mass of robot and objects, and of all that moves."""
    for tree in system.trees:
        yield NamedPoint(f"centre of mass of {tree.name}", data.subtree_com[tree.root].copy())
    if system.objects:
        masses = np.array([system.mj.body_subtreemass[tree.root] for tree in system.trees])
        points = np.array([data.subtree_com[tree.root] for tree in system.trees])
        yield NamedPoint("centre of mass of all", masses @ points / masses.sum())


def _quaternion(data: Any, site: int) -> str:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
    return _numbers(quaternion, "6.3f")


def _numbers(values: FloatArray, form: str) -> str:
    return " ".join(f"{value + 0.0:{form}}" for value in np.where(np.abs(values) < 5e-5, 0.0, values))


def notes(assembly: Assembly) -> list[str]:
    """What a user should know about the scenario before it runs, one line each."""
    return [
        *assembly.system.notes,
        *contact_notes(assembly.contacts, assembly.system),
        *union_notes(assembly.contacts, assembly.system),
        *_unwatched_overlaps(assembly),
        *assembly.start_notes,
        *initial_notes(assembly),
        *unstable_damping(assembly),
        *undriven_actuators(assembly.system, assembly.controller.phases),
        *loop_notes(assembly),
        *friction_notes(assembly),
        *orbit_notes(assembly),
        *never_armed(assembly.scenario),
    ]


def describe(assembly: Assembly) -> list[str]:
    """Lines of text that describe the run, with notes."""
    scenario, system, initial = assembly.scenario, assembly.system, assembly.scenario.initial
    lines = [
        f"{scenario.name}: valid",
        *(f"  {tree.name}: bodies {len(tree.bodies)}, dofs {tree.dofs.stop - tree.dofs.start}" for tree in system.trees),
        *(f"  {body.name}: fixed, bodies {len(body.bodies)}" for body in system.fixed),
        *_changes(assembly),
        *piece_lines(system),
        *(f"  {line}" for line in rule_lines(assembly.contacts)),
        *_disarmed_pairs(assembly),
        *(f"  {line}" for line in cone_lines(assembly.contacts, assembly.system)),
        *union_lines(assembly.contacts, system),
        *_limited_joints(assembly.limits),
        *spring_lines(scenario, system, assembly.data),
        *_servos(assembly),
        *_dry_friction(system),
        *loop_lines(assembly),
        *_sensors(assembly),
        *([f"  goes on from {initial.from_} at t = {initial.at_s:g} s"] if initial.from_ is not None else []),
        *_phases(scenario),
        f"  {scenario.ticks} control ticks of {scenario.control_period_s:g} s, steps of {scenario.time_step_s:g} s",
        *initial_lines(assembly),
    ]
    outside = [*filter(None, [gravity_line(gravity_metadata(system.mj.opt.gravity))]), *orbit_lines(assembly)]
    lines += [f"breaks conservation: {fault}" for fault in system.faults] or [
        *(outside or ["conservative: nothing in the models breaks it"])
    ]
    return lines + [f"note: {note}" for note in (*notes(assembly), *mesh_notes(assembly.contacts, system))]


def _changes(assembly: Assembly) -> list[str]:
    """A heading and a line for each property of the models that the scenario changes; none without any."""
    lines = [f"    {change.sentence}" for change in assembly.compiled.changes]
    return ["  properties that the scenario changes", *lines] if lines else []


def _phases(scenario: ScenarioConfig) -> list[str]:
    """The phases in a line, or their graph where they branch."""
    phases = scenario.phases
    if not is_branching(phases):
        return [f"  phases: {', '.join(f'{phase.name} ({phase.kind})' for phase in phases)}"]
    return ["  phases:", *(f"    {line}" for line in graph_lines(phases))]


def _sensors(assembly: Assembly) -> list[str]:
    """A heading with the estimator and a line for each sensor; none if there are no sensors."""
    sampler = assembly.plant.sampler
    if sampler is None:
        return []
    lines = [
        f"    {sensor.name}: {sensor.model.kind}, every {sensor.interval_s:g} s"
        + _lateness(sensor)
        + (", nothing arrives within the run" if _never_arrives(sensor, assembly.scenario.duration_s) else "")
        for sensor in sampler.by_name.values()
    ]
    return [f"  sensors (estimator {assembly.scenario.estimator.kind})", *lines]


def _lateness(sensor: Sensor) -> str:
    """How late samples of a sensor are, and the share that is lost."""
    latest_s = sensor.delay_s + sensor.delay_jitter_s
    late = f"{sensor.delay_s:g} to {latest_s:g}" if sensor.delay_jitter_s else f"{latest_s:g}"
    return (f", {late} s late" if latest_s else "") + (f", {sensor.dropout:.3g} of all lost" if sensor.dropout else "")


def _never_arrives(sensor: Sensor, duration_s: float) -> bool:
    return sensor.dropout == 1.0 or sensor.earliest_s >= duration_s


def _limited_joints(limits: Sequence[JointLimit]) -> list[str]:
    """A heading and a line for each joint that stops at its limits; none if there are no such joints."""
    ends = zip(limits[::2], limits[1::2], strict=True)
    joints = [
        f"    {low.joint}: {low.limit:.4g} to {high.limit:.4g} {low.unit}, e = {low.restitution:g}" for low, high in ends
    ]
    return ["  joints that stop at their limits", *joints] if joints else []


def _servos(assembly: Assembly) -> list[str]:
    """A line on the servos, their fastest rate at the initial state, and the steps that it asks for; none without servos."""
    model, integrator = assembly.system.mj, assembly.plant.integrator
    servos = int((servo_mask(model) & ~further_inputs(model)).sum())
    if not servos:
        return []
    motion = integrator.motion
    fastest = max(StiffActuators(model, assembly.data, motion.constrained).fastest())
    kind = "implicit" if motion.stiff is not None else "explicit"
    divided = " and divided where their error needs it" if integrator.control is not None else ""
    steps = f"steps are {kind}{divided}"
    return [f"  servos: {servos}, fastest rate {fastest:.4g} 1/s with springs, dampers and activations; {steps}"]


def _dry_friction(system: System) -> list[str]:
    """A heading and a line for each joint and tendon with dry friction; none if there are none."""
    on = friction_coordinates(system)
    if on is None:
        return []
    kinds = ["joint"] * len(on.dofs) + ["tendon"] * len(on.tendons)
    rows = zip(kinds, on.names, on.limits, on.units, strict=True)
    return [
        "  dry friction",
        *(f"    {kind} {name}: {limit:.4g} {force_unit(unit)}" for kind, name, limit, unit in rows),
    ]
