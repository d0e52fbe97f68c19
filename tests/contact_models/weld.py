"""A geom that grips another at touch, while it is armed: what moves from then on is another model, until it is released."""

from __future__ import annotations

import math
from typing import Literal

import mujoco
import numpy as np
from pydantic import Field
from scipy.optimize import brentq

from ffsm_mj.balance.exchange import Exchange
from ffsm_mj.config import StrictModel
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact_models.interface import ContactModel, EventEffect, EventSource, ForceSource, Replayable
from ffsm_mj.dynamics.motion import Motion
from ffsm_mj.dynamics.rigid_body import kinetic_energy, mass_matrix, momentum_matrix
from ffsm_mj.model.composition import part, place
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.events import QPOS, QVEL_AFTER, QVEL_BEFORE, STEP
from ffsm_mj.records.kinds import RecordKind
from ffsm_mj.records.record import ByName, Values, declared, record
from ffsm_mj.records.signals import Signal

_FAR = 1e3


class WeldConfig(StrictModel):
    """A gripper's geom and an object's."""

    kind: Literal["weld"]
    geoms: tuple[str, ...] = Field(min_length=2, max_length=2)
    armed: bool = False
    """Grip at the first touch, without a request."""


@record
class WeldRecord:
    """The object is held from here on, or is released."""

    time_s: float = declared("Simulation time.")
    step: int = declared(STEP)
    held: int = declared("1 from here on, or 0.")
    loss_J: float = declared("Energy lost.")
    qpos: Values = declared(QPOS)
    qvel_before: ByName = declared(QVEL_BEFORE)
    qvel_after: ByName = declared(QVEL_AFTER)
    efforts_after: ByName = declared("Effort by actuator after the event.", default_factory=dict)


WELD = RecordKind(
    record=WeldRecord,
    name="weld",
    plural="welds",
    when="when the object is held or released",
    time=lambda record: record.time_s,
    sentence=lambda record: f"the object is {'held' if record.held else 'released'}",
)


class Weld(ContactModel, EventSource, ForceSource, Replayable):
    """Holds an object."""

    kind = "weld"
    Config = WeldConfig
    records = (WELD,)
    requests = ("weld.arm", "weld.release")

    def __init__(self, config, scene):
        super().__init__(config, scene)
        self._model = scene.system.mj
        self._pair = ContactPair(scene.system, "weld", *config.geoms, 0.0)
        self.watched = frozenset((self._pair.geom_ids,))
        self._armed, self._release, self._free, self._moving = config.armed, False, None, None
        self._held = np.zeros(1)
        self.columns = (
            Columns(
                (Signal("contact", "weld_held", "", "1 while the object is held"),), live=self._held, resume=self._resume
            ),
        )

    @property
    def event_bound(self):
        return -math.inf if self._armed or self._release else math.inf

    def handle_request(self, request):
        self._armed = request == "weld.arm" and not self.active
        self._release = request == "weld.release" and self.active

    def due(self):
        return self._release

    def is_clear(self):
        return not self._armed or self._gap() > 0.0

    def first_event(self, duration_s):
        def gap(time_s):
            self.motion.path.move_to(time_s)
            return self._gap()

        start, end = gap(0.0), gap(duration_s)
        return float(brentq(gap, 0.0, duration_s, xtol=1e-15)) if start > 0.0 > end else 0.0 if end <= 0.0 else None

    def act(self, instant):
        system, data = self.scene.system, self.scene.data
        before, loss, booking = np.array(data.qvel), 0.0, None
        if self.active:
            self._moving = self._free
        else:
            self._free = self.motion
            booking = self._stop()
            loss, self._moving = -float(booking.energy_J[0]), Held(self._free, self.scene, self._pair)
        self.active, self._armed, self._release = not self.active, False, False
        self._held[0] = float(self.active)
        rates = system.by_joint(before), system.by_joint(data.qvel)
        record = WeldRecord(instant.time_s, instant.step, int(self.active), loss, tuple(data.qpos.tolist()), *rates)
        return EventEffect((record,), booking, self._moving)

    def _stop(self):
        """The plastic impulse that leaves no relative twist at the grip."""
        model, data, system = self._model, self.scene.data, self.scene.system
        point = self._pair.proximity(model, data).points[0]
        J = np.zeros((6, model.nv))
        for body, sign in ((self._pair.body_a, -1.0), (self._pair.body_b, 1.0)):
            jacobian = np.zeros((6, model.nv))
            mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], point, body)
            J += sign * jacobian
        M = mass_matrix(model, data)
        response = np.linalg.solve(M, J.T)
        impulse = -np.linalg.solve(J @ response, J @ data.qvel)
        before = _energies(system, data)
        data.qvel += response @ impulse
        mujoco.mj_forward(model, data)
        wrench = np.concatenate((impulse[:3], impulse[3:] + np.cross(point, impulse[:3])))
        return Exchange(_energies(system, data) - before, wrench)

    def begin_step(self, left_s, *, continues=False):
        self._before = self._state_of_object()
        return left_s

    def end_step(self, duration_s, *, trial=False):
        """The object is pushed by the grip alone: what it gained is what the grip gave, and took from the robot."""
        change = self._state_of_object() - self._before
        return Exchange(change[0] * np.array((0.0, -1.0, 1.0)), change[1:])

    def _state_of_object(self):
        model, data = self._model, self.scene.data
        tree = self.scene.system.tree_of_body(self._pair.body_b)
        energy = 0.5 * data.qvel[tree.dofs] @ (mass_matrix(model, data) @ data.qvel)[tree.dofs]
        return np.append(energy, momentum_matrix(model, data, tree.root) @ data.qvel)

    def restore_state(self, events=()):
        self._free, self.active = self._free or self.motion, bool(self._held[0])
        self._moving = Held(self._free, self.scene, self._pair) if self.active else self._free

    def current_motion(self):
        return self._moving

    def _resume(self, values):
        self._held[:] = values

    def _gap(self):
        return self._pair.gap(self._model, self.scene.data, _FAR)


def _energies(system, data):
    """Kinetic energy of (total, robot, objects)."""
    M = mass_matrix(system.mj, data)
    robot = system.robot.dofs
    own = 0.5 * float(data.qvel[robot] @ (M @ data.qvel)[robot])
    total = kinetic_energy(M, data.qvel)
    return np.array((total, own, total - own))


class Held(Motion):
    """The robot with the object as a part of the body that grips it."""

    def __init__(self, free, scene, pair):
        self._free, self._system = free, scene.system
        tree = scene.system.tree_of_body(pair.body_b)
        model = _held_model(scene, pair, tree)
        data = mujoco.MjData(model)
        self._root, self._object = model.body(scene.system.mj.body(tree.root).name).id, tree
        # All joints but that of the object: where they are in the free model, and here.
        kept = [joint for joint in scene.system.joints.values() if joint not in tree.joints]
        self._joints = [(joint, model.joint(joint.name)) for joint in kept]
        for joint, here in self._joints:
            data.qpos[here.qposadr[0] :][: joint.qpos.stop - joint.qpos.start] = scene.data.qpos[joint.qpos]
            data.qvel[here.dofadr[0] :][: joint.dofs.stop - joint.dofs.start] = scene.data.qvel[joint.dofs]
        data.time = scene.data.time
        data.ctrl[:] = scene.data.ctrl
        mujoco.mj_forward(model, data)
        super().__init__(model, data)
        self.bodies = [model.body(scene.system.mj.body(i).name).id for i in range(scene.system.mj.nbody)]
        self.path.on_event_located = self._fill

    def step(self, duration_s):
        self.data.ctrl[:] = self._free.data.ctrl
        clear = super().step(duration_s)
        self._fill()
        return clear

    def follow(self):
        """Bring the free system to the state here."""
        data, free = self.data, self._free.data
        for joint, here in self._joints:
            free.qpos[joint.qpos] = data.qpos[here.qposadr[0] :][: joint.qpos.stop - joint.qpos.start]
            free.qvel[joint.dofs] = data.qvel[here.dofadr[0] :][: joint.dofs.stop - joint.dofs.start]
        twist, (joint,) = np.empty(6), self._object.joints
        mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_XBODY, self._root, twist, 0)
        free.qpos[joint.qpos] = np.concatenate((data.xpos[self._root], data.xquat[self._root]))
        turn = data.xmat[self._root].reshape(3, 3)
        free.qvel[joint.dofs] = np.concatenate((twist[3:], turn.T @ twist[:3]))
        free.time = data.time
        mujoco.mj_fwdPosition(self._free.model, free)
        mujoco.mj_fwdVelocity(self._free.model, free)

    def _fill(self):
        self.follow()
        mujoco.mj_forward(self._free.model, self._free.data)
        mujoco.mj_mulM(self._free.model, self._free.data, self._free.momentum, self._free.data.qvel)


def _held_model(scene, pair, tree):
    """Compiled anew: the object without its joint, fixed to the gripping body in the pose of this instant."""
    system, data = scene.system, scene.data
    root = data.body(tree.root)
    whole = mujoco.MjSpec()
    with mujoco.MjVfs() as vfs:
        specs = {name: part(name, files, vfs).spec for name, files in system.files.items()}
        for spec in (whole, *specs.values()):
            for option in ("gravity", "integrator", "timestep", "disableflags"):
                setattr(spec.option, option, getattr(system.mj.opt, option))
        thing = specs.pop(tree.name)
        for name, spec in specs.items():
            whole.attach(spec, prefix=f"{name}/", frame=place(whole, name, system.files[name].pose))
        body = thing.worldbody.first_body()
        for joint in body.joints:
            thing.delete(joint)
        body.pos, body.quat = np.zeros(3), np.array((1.0, 0.0, 0.0, 0.0))
        gripper = data.body(pair.body_a)
        turn = gripper.xmat.reshape(3, 3)
        back, relative = np.empty(4), np.empty(4)
        mujoco.mju_negQuat(back, gripper.xquat)
        mujoco.mju_mulQuat(relative, back, root.xquat)
        frame = whole.body(system.mj.body(pair.body_a).name).add_frame(
            pos=turn.T @ (root.xpos - gripper.xpos), quat=relative
        )
        frame.attach_body(body, f"{tree.name}/", "")
        return whole.compile(vfs=vfs)
