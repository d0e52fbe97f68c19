"""Grasps of a scenario: their sites, and the systems with a grasped object, compiled before the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ffsm_mj.contact_models.grasp.grasped_motion import check_grasped_system
from ffsm_mj.contact_models.grasp.loops import LoopForces
from ffsm_mj.contact_models.grasp.model import GraspModel
from ffsm_mj.contact_models.interface import ForceSource, Scene
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.errors import Faults, unknown_name
from ffsm_mj.model.grasp import Grasp
from ffsm_mj.model.system import System, Tree
from ffsm_mj.scenario.scenario import ScenarioConfig

if TYPE_CHECKING:
    from ffsm_mj.contact_models.joint_friction.model import JointFriction


@dataclass(frozen=True)
class GraspedSystem:
    """A system with a grasped object.

    Attributes:
        grasp: The grasp: link and object.
        system: Robot and objects, the grasped one as a part of the robot.
        controller_system: The same of the controller model; None: control laws know the plant.
    """

    grasp: Grasp
    system: System
    controller_system: System | None = None

    def copy(self) -> GraspedSystem:
        """Copy with separate models."""
        controller_system = self.controller_system.copy() if self.controller_system is not None else None
        return GraspedSystem(self.grasp, self.system.copy(), controller_system)


def grasps_of(scenario: ScenarioConfig, system: System) -> tuple[Grasp, ...]:
    """Grasps of a scenario, in its order.

    Raises:
        ScenarioFaults: An unknown site, a site of the wrong model, or an object that cannot be grasped.
    """
    grasps = []
    with Faults() as faults:
        for name, config in scenario.grasps.items():
            sites: dict[str, str] = {}
            with faults.below("grasps", name, "object_site"):
                sites["object_site"] = _site(system, config.object_site, [*system.objects])
            with faults.below("grasps", name, "robot_site"):
                sites["robot_site"] = _link_site(system, config.robot_site, sites)
            if len(sites) < 2:
                continue
            tree, site_body = _tree(system, sites["object_site"]), system.mj.site(sites["object_site"]).bodyid[0]
            link = system.mj.body(system.mj.site(sites["robot_site"]).bodyid[0]).name
            if tree is not None:
                body = system.mj.body(tree.root if _on_base(system, sites["object_site"], tree) else site_body).name
                joint, load = config.latch_joint, config.greatest_load
                grasps.append(Grasp(name, sites["robot_site"], sites["object_site"], link, tree.name, body, joint, *load))
    return tuple(grasps)


def _link_site(system: System, name: str, sites: Mapping[str, str]) -> str:
    """Full name of the site on the grasping link: of the robot, or of another object than the grasped one.

    Raises:
        LookupError: It is neither.
    """
    try:
        return _site(system, name, [system.robot])
    except LookupError:
        matches = [site for site in system.names("site") if name in (site, site.split("/", 1)[-1])]
        tree = _tree(system, matches[0]) if len(matches) == 1 else None
        if "object_site" in sites and tree in system.objects and tree is not _tree(system, sites["object_site"]):
            return matches[0]
        raise


def is_of_robot(system: System, grasp: Grasp) -> bool:
    """Whether the grasping link is of the robot, and not of another object."""
    return system.tree_of_body(system.index("body", grasp.link)) is system.robot


def attaches(system: System, grasp: Grasp) -> bool:
    """Whether the object of a grasp becomes a child of the link: of the robot, which grasps the base of the object.

    Rows hold the others: a moving link of an object keeps its place in the object's tree, and so does another object.
    """
    return is_of_robot(system, grasp) and system.index("body", grasp.root) in {tree.root for tree in system.objects}


def _site(system: System, name: str, whose: list[Tree]) -> str:
    """Full name of a site of one of some trees.

    Raises:
        LookupError: An unknown site, or a site of another model.
    """
    sites = [candidate for candidate in system.names("site") if _tree(system, candidate) in whose]
    side = "the robot" if system.robot in whose else "a floating object"
    message = unknown_name(f"site of {side}", name, sites) if sites else f"no site of {side} is in its model; add one"
    try:
        full = system.resolve("site", name)
    except LookupError as error:
        raise LookupError(message if str(error).startswith("unknown") else str(error)) from error
    tree = _tree(system, full)
    if tree is None or tree not in whose:
        raise LookupError(f"{full} is not a site of {side}: {message}" if sites else message)
    return full


def _tree(system: System, site: str) -> Tree | None:
    return system.tree_of_body(int(system.mj.site(site).bodyid[0]))


def _on_base(system: System, site: str, tree: Tree) -> bool:
    weld = system.mj.body_weldid
    return bool(weld[int(system.mj.site(site).bodyid[0])] == weld[tree.root])


def grasped_systems_of(
    scenario: ScenarioConfig, system: System, compiled: Callable[[Grasp, bool], System]
) -> Mapping[str, GraspedSystem]:
    """Compile the systems with grasped objects, by the name of the grasp; none for grasps that rows alone hold.

    Args:
        scenario: What is asked for.
        system: The scene as it begins.
        compiled: Compiles a scene in which a grasp holds; with True the one that control laws believe in.

    Raises:
        ScenarioFaults: An object that cannot be held.
    """
    systems = {}
    with Faults() as faults:
        for grasp in [attaching for attaching in grasps_of(scenario, system) if attaches(system, attaching)]:
            grasped = compiled(grasp, False)
            with faults.below("grasps", grasp.name, "object_site"):
                check_grasped_system(system, grasped, grasp)
            controller_system = compiled(grasp, True) if scenario.has_controller_model else None
            systems[grasp.name] = GraspedSystem(grasp, grasped, controller_system)
    return systems


def grasp_models_of(
    scenario: ScenarioConfig,
    scene: Scene,
    free: Motion,
    grasped_systems: Mapping[str, GraspedSystem],
    others: Sequence[ForceSource],
    friction: JointFriction | None,
) -> tuple[LoopForces | None, GraspModel | None]:
    """Rows of equality constraints, of further grasps and of joints at rest, and the events of grasps.

    None each where there are none.

    Args:
        scenario: What is asked for.
        scene: The system that is logged.
        free: Its motion.
        grasped_systems: Systems in which objects are held, with models of the run's own.
        others: Who may push what is held.
        friction: Dry friction of joints, with its rows; None: there is none.
    """
    if friction is not None:
        others = (*others, friction)
    loops = friction.loops if friction is not None else LoopForces(scene, others)
    if not scenario.grasps:
        return (loops if friction is not None or scene.system.equalities else None), None
    grasps = [
        (grasp, scenario.grasps[grasp.name], grasped_systems[grasp.name].system if grasp.name in grasped_systems else None)
        for grasp in grasps_of(scenario, scene.system)
    ]
    return loops, GraspModel(scene, free, grasps, loops, others)
