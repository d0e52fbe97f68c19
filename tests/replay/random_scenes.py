"""Random scenes in space of all that a run may hold, to compare its checks with those recomputed from its log."""

from __future__ import annotations

import json
import math
from itertools import pairwise, product
from typing import Literal

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.controller_protocol import StrictModel
from ffsm_mj.errors import InputError
from tests.scenes import HEAD, scene

STEPS_S = (5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
RESTITUTIONS = (0.0, 0.0, 0.3, 0.5, 0.8, 0.95, 1.0)
KINDS = ("sphere", "capsule", "box", "cylinder", "ellipsoid", "mesh")
OBJECTS = ("first", "second", "third")


class WavesConfig(StrictModel):
    """Efforts of all actuators: bias + amplitude sin(rate t + phase); jets and wheels switch with the sign of the wave."""

    kind: Literal["waves"]
    bias: tuple[float, ...]
    amplitude: tuple[float, ...]
    rate_rad_s: tuple[float, ...]
    phase_rad: tuple[float, ...]
    switched: tuple[bool, ...]
    damping: float


class Waves:
    """Smooth or switched efforts, with a damping of the joints."""

    Config = WavesConfig
    telemetry_signals = ()

    def __init__(self, config, context):
        model = context.system.mj
        self._config, self._all = config, np.arange(model.nu)
        on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
        self._joints = np.flatnonzero(on_joint & ~np.array(config.switched, dtype=bool))
        self._dofs = model.jnt_dofadr[model.actuator_trnid[self._joints, 0]]

    def start(self, observation):
        """Nothing to take."""

    def control(self, observation, command):
        said = self._config
        waves = np.sin(np.array(said.rate_rad_s) * observation.time_s + np.array(said.phase_rad))
        waves = np.where(said.switched, np.sign(waves), waves)
        efforts = np.array(said.bias) + np.array(said.amplitude) * waves
        # While an object is held another model moves; joints and their order are the same, dofs of the object may not be.
        efforts[self._joints] -= said.damping * observation.free.qvel[self._dofs]
        command.drive(self._all, efforts)

    def telemetry(self):
        return ()


LAWS = {"waves": Waves}


def drawn(seed, folder):
    """The first scene of a seed whose pairs do not overlap at the start; returns the scenario's path."""
    rng = np.random.default_rng(seed)
    while True:
        try:
            path = _Drawing(rng, folder).written()
            prepare(path, controllers=LAWS)
        except InputError as error:
            assert "overlap" in str(error), error  # noqa: PT017 (the only refusal that there may be)
        else:
            return path


def _numbers(values):
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


class _Drawing:
    """One scene: an arm on a free base, one to three free objects in a line before it, perhaps something fixed behind."""

    def __init__(self, rng, folder):
        self.rng, self.folder = rng, folder
        (self.latches,) = rng.spawn(1)  # numbers of its own: the rest of a scene does not depend on them
        self.step, self.presses = float(rng.choice(STEPS_S)), bool(rng.random() < 0.5)
        self.motors, self.switched = [], []
        self.pairs = []

    def written(self):
        rng = self.rng
        links = int(rng.integers(1, 5))
        objects = {name: self.free_body(name) for name in OBJECTS[: int(rng.integers(1, 4))]}
        robot = self.robot(links)
        behind = str(rng.choice(["wall", "wall", "slab", ""] if self.presses else ["", "", "wall", "slab"]))
        fixed = {}
        if behind:
            half = "0.3 1 1" if behind == "wall" else f"{rng.uniform(0.02, 0.1)} 0.4 0.5"
            objects[behind] = (
                f'<mujoco>{HEAD}<worldbody><geom name="{behind}" type="box" size="{half}" mass="0"/></worldbody></mujoco>'
            )
            fixed[behind] = {"position_m": [4.0, 0.0, 0.0], "quaternion": self.turn(0.5)}
        start, rates = self.start(links, [name for name in objects if name != behind])
        self.draw_pairs(links, [*objects])
        step = self.step
        tick = step * int(rng.choice([1, 1, 2]))
        duration = round(min(1.0, max(0.4, 200 * step)) / tick) * tick
        path = scene(
            self.folder,
            robot,
            objects,
            fixed=fixed,
            duration_s=duration,
            time_step_s=step,
            control_period_s=tick,
            initial={"joints": start, "rates": rates},
            contacts={
                "rules": self.pairs,
                "ignored": [{"between": ["robot", "self"], "reason": "an arm may lie across itself"}],
            },
            **self.phases(duration),
        )
        self.line_up(path, behind)
        return path

    def turn(self, share=0.3):
        """A quaternion, (w, x, y, z): none at all in a share of the cases."""
        if self.rng.random() < share:
            return [1.0, 0.0, 0.0, 0.0]
        q = self.rng.normal(size=4)
        return (q / np.linalg.norm(q)).tolist()

    def inertial(self, mass, size):
        """Of a body that is a body: principal moments are sums of two squares."""
        a, b, c = mass * (size * self.rng.uniform(0.3, 1.0, 3)) ** 2
        place = _numbers(0.2 * size * self.rng.normal(size=3) * (self.rng.random() < 0.7))
        moments = _numbers([b + c, a + c, a + b])
        return f'<inertial pos="{place}" quat="{_numbers(self.turn())}" mass="{mass}" diaginertia="{moments}"/>'

    def geom(self, name, size, at=(0.0, 0.0, 0.0)):
        """A geom of any convex kind; returns its element and that of its mesh, if it has one."""
        rng, kind = self.rng, str(self.rng.choice(KINDS))
        a, b, c = (size * rng.uniform(0.5, 1.3, 3)).tolist()
        place = f'name="{name}" pos="{_numbers(at)}" quat="{_numbers(self.turn())}" mass="0"'
        if kind == "mesh":
            points = self.vertices() * (a, b, c)
            asset = f'<mesh name="{name}" vertex="{_numbers(points.ravel())}"/>'
            return f'<geom {place} type="mesh" mesh="{name}"/>', asset
        sizes = {"sphere": [a], "capsule": [a, b], "cylinder": [a, b]}.get(kind, [a, b, c])
        return f'<geom {place} type="{kind}" size="{_numbers(sizes)}"/>', ""

    def vertices(self):
        """Of a mesh of about unit size: of a random hull, or with faces that are flat to single precision only."""
        rng, kind = self.rng, str(self.rng.choice(["hull", "hull", "frustum", "prism", "grid"]))
        if kind == "frustum":
            top = rng.uniform(0.4, 1.0)
            return np.array([[x * s, y * s, z] for z, s in ((-1, 1), (1, top)) for x in (-1, 1) for y in (-1, 1)])
        if kind == "prism":
            angles = 2.0 * math.pi * np.arange(count := int(rng.integers(3, 12))) / count
            return np.array([[math.cos(angle), math.sin(angle), z] for z in (-1, 1) for angle in angles])
        if kind == "grid":
            return np.array([*product((-1.0, 0.0, 1.0), repeat=3)])
        points = rng.normal(size=(int(rng.integers(6, 16)), 3))
        return points / np.linalg.norm(points, axis=1)[:, None]

    def free_body(self, name):
        rng, size = self.rng, float(self.rng.uniform(0.08, 0.2))
        geom, asset = self.geom(name, size)
        inertial = self.inertial(float(rng.uniform(0.3, 4.0)), size)
        site = f'<site name="handle" pos="{_numbers(0.5 * size * rng.normal(size=3))}" quat="{_numbers(self.turn())}"/>'
        return f"""<mujoco>{HEAD}<asset>{asset}</asset><worldbody><body name="{name}"><freejoint name="free"/>
          {inertial}{geom}{site}</body></worldbody></mujoco>"""

    def robot(self, links):
        rng = self.rng
        bus, assets = self.geom("bus", 0.2)
        body, ends, actuators = "", "", ""
        for i in range(links):
            slides = rng.random() < 0.35 or (self.presses and i == 0)
            axis = rng.normal(size=3)
            if slides and (self.presses or rng.random() < 0.7):
                axis = np.array([1.0, 0.1 * rng.normal(), 0.1 * rng.normal()])
            where = 0.35 if i == 0 else 0.25
            geom, asset = self.geom(f"link{i}", 0.09, (0.12, 0.0, 0.0))
            assets += asset
            body += f"""<body name="link{i}" pos="{where} 0 0">
              <joint name="j{i}" type="{"slide" if slides else "hinge"}" axis="{_numbers(axis / np.linalg.norm(axis))}"/>
              {self.inertial(float(rng.uniform(0.3, 2.0)), 0.15)}{geom}"""
            ends += "</body>"
            actuators += f'<motor name="m{i}" joint="j{i}"/>'
            self.motors.append(float(10.0 ** rng.uniform(-0.5, 1.0)) * (1.0 if slides else 0.15))
            self.switched.append(False)
        tip = f'<site name="tip" pos="{_numbers([0.2, *(0.03 * rng.normal(size=2))])}" quat="{_numbers(self.turn())}"/>'
        fittings = ""
        if rng.random() < 0.4:
            fittings += '<site name="jet" pos="-0.2 0.05 0.02" quat="0.9 0.1 0.2 0.3"/>'
            actuators += (
                '<motor name="jet" site="jet" gear="1 0 0 0 0 0"/><motor name="torquer" site="jet" gear="0 0 0 0 1 0"/>'
            )
            self.motors += [float(rng.uniform(0.5, 5.0)), float(rng.uniform(0.05, 0.5))]
            self.switched += [True, True]
        if rng.random() < 0.4:
            fittings += f"""<body name="wheel" pos="-0.1 0 0.05"><joint name="wheel" axis="{_numbers(rng.normal(size=3))}"/>
              <inertial pos="0 0 0" mass="0.5" diaginertia="0.002 0.002 0.004"/></body>"""
            actuators += '<motor name="wheel" joint="wheel"/>'
            self.motors.append(float(rng.uniform(0.01, 0.1)))
            self.switched.append(True)
        base = self.inertial(float(rng.uniform(4.0, 20.0)), 0.4)
        return f"""<mujoco>{HEAD}<asset>{assets}</asset><worldbody><body name="base"><freejoint name="free"/>{base}{bus}
          {fittings}{body}{tip}{ends}</body></worldbody><actuator>{actuators}</actuator></mujoco>"""

    def start(self, links, names):
        rng = self.rng
        spin = lambda: rng.choice([0.0, 0.3, 3.0]) * rng.normal(size=3)  # noqa: E731
        joints = {"robot/free": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]}
        rates = {"robot/free": [*(0.1 * rng.normal(size=3)), *(0.1 * spin())]}
        for i in range(links):
            joints[f"j{i}"], rates[f"j{i}"] = float(0.1 * rng.normal()), float(rng.choice([0.0, 0.5]) * rng.normal())
        for k, name in enumerate(names):
            joints[f"{name}/free"] = [1.5 + 0.6 * k, *(0.04 * rng.normal(size=2)), *self.turn()]
            toward = -rng.uniform(0.1, 1.0) if k == 0 else rng.choice([0.0, 0.0, -0.5])
            rates[f"{name}/free"] = [toward, *(0.05 * rng.normal(size=2)), *spin()]
        if rng.random() < 0.25:
            rates["robot/free"] = [0.0] * 6
        return joints, {name: [float(x) for x in rate] if isinstance(rate, list) else rate for name, rate in rates.items()}

    def draw_pairs(self, links, names):
        """Of every link and the bus with every object in half of the scenes, else of neighbours; of objects in line."""
        rng, rough = self.rng, self.rng.random() < 0.25
        moving = ["bus", *(f"link{i}" for i in range(links))]
        met = [(geom, name) for geom in moving for name in names] if rng.random() < 0.5 else [(moving[-1], names[0])]
        geoms = [(geom, f"{name}/{name}") for geom, name in met]
        geoms += [(f"{a}/{a}", f"{b}/{b}") for a, b in pairwise(names)]
        usual = 0.0 if self.presses else float(rng.choice(RESTITUTIONS))
        for a, b in geoms:
            e = usual if rng.random() < 0.6 else float(rng.choice(RESTITUTIONS))
            if self.presses and e == 1.0:
                continue  # what is pressed and never rests bounces a thousand times in a step
            mu = {"mu": float(rng.uniform(0.05, 0.8))} if rough and rng.random() < 0.6 else {}
            self.pairs.append({"between": [a, b], "restitution": e, "name": f"{a}-{b}".replace("/", "_"), **mu})

    def phases(self, duration):
        """Waves from the start to the end; in two of five scenes with a grasp that closes and lets go."""
        rng, count = self.rng, len(self.motors)
        bias = rng.uniform(0.5, 2.0) if self.presses else rng.choice([0.0, 0.5])
        waves = {
            "kind": "waves",
            "bias": [float(x) for x in np.array(self.motors) * bias * ~np.array(self.switched)],
            "amplitude": self.motors,
            "rate_rad_s": rng.uniform(2.0, 30.0, count).tolist(),
            "phase_rad": rng.uniform(0.0, 2.0 * math.pi, count).tolist(),
            "switched": self.switched,
            "damping": float(rng.choice([0.0, 0.5])),
        }
        if rng.random() > 0.4:
            return {"phases": [{"name": "move", "until": "end", "controller": waves}]}
        touches = [pair["name"] for pair in self.pairs if pair["between"][1] == "first/first" and "mu" not in pair]
        when = {"within": {"position_m": float(rng.uniform(0.15, 0.5)), "speed_m_s": float(rng.uniform(0.5, 3.0))}}
        if touches and rng.random() < 0.6:
            when = {"touch": touches}
        hold = max(1, round(rng.uniform(0.1, 0.5) * duration / 0.01)) * 0.01
        sites = {"robot_site": "tip", "object_site": "first/handle"}
        locks = {"arm": ["lock"]} if self.latches.random() < 0.4 else {}
        return {
            "captures": {
                "grasp": {**sites, "when": when, **self.joint()},
                "lock": {**sites, "when": {"within": {"speed_m_s": float(self.latches.uniform(0.02, 0.5))}}},
            },
            "phases": [
                {"name": "meet", "until": "capture", "for_s": 0.8 * duration, "arm": ["grasp"], "controller": waves},
                {"name": "hold", "for_s": hold, **locks, "controller": waves},
                {"name": "leave", "until": "end", "release": ["grasp", "lock"], "controller": waves},
            ],
        }

    def joint(self):
        """What a latch leaves free: nothing in a third of them."""
        kind = str(self.latches.choice(["rigid", "rigid", "ball", "hinge", "slide", "cylindrical"]))
        axis = {} if kind in ("rigid", "ball") else {"axis": self.latches.normal(size=3).tolist()}
        return {"joint": kind, **axis}

    def line_up(self, path, behind):
        """Move the objects along x to drawn gaps, one before the other; then turn the whole, boost it where it floats."""
        rng, said = self.rng, json.loads(path.read_text())
        parts = prepare(path, controllers=LAWS).assemble()
        model, data = parts.system.mj, parts.data
        mujoco.mj_kinematics(model, data)
        ahead = [g for g in range(model.ngeom) if model.geom(g).name.startswith("robot/")]
        start = said["initial"]["joints"]
        for name in said["objects"]:
            geom = model.geom(f"{name}/{name}").id
            wanted = float(rng.choice([1e-12, 1e-4, 3e-3, 1e-2] if self.presses else [1e-12, 1e-4, 3e-3, 1e-2, 3e-2]))
            shift = self.clear(model, data, ahead, geom) - wanted
            data.geom_xpos[geom, 0] -= shift
            where = said["objects"][name]["pose"]["position_m"] if name == behind else start[f"{name}/free"]
            where[0] -= shift
            ahead.append(geom)
        turn = Rotation.from_quat(self.turn(0.4), scalar_first=True)
        if behind:
            move(said["objects"][behind]["pose"], turn)
        boost = np.zeros(3) if behind else rng.choice([0.0, 0.0, 1.0]) * rng.normal(size=3)
        for name in [name for name in start if name.endswith("/free")]:
            pose, rate = start[name], said["initial"]["rates"][name]
            pose[:3], pose[3:] = (
                turn.apply(pose[:3]).tolist(),
                (turn * Rotation.from_quat(pose[3:], scalar_first=True)).as_quat(scalar_first=True).tolist(),
            )
            rate[:3] = (turn.apply(rate[:3]) + boost).tolist()
        path.write_text(json.dumps(said))

    @staticmethod
    def clear(model, data, ahead, geom):
        """How far a geom can move towards -x before it meets one of those before it."""
        start = data.geom_xpos[geom, 0]

        def gap(shift):
            data.geom_xpos[geom, 0] = start - shift
            return min(mujoco.mj_geomDistance(model, data, other, geom, 9.0, None) for other in ahead)

        low, high = 0.0, 0.0
        while gap(high) > 0.0 and high < 9.0:
            low, high = high, high + 0.02
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if gap(middle) > 0.0 else (low, middle)
        data.geom_xpos[geom, 0] = start
        return low


def move(pose, turn):
    """Turn a pose of a scenario about the origin."""
    pose["position_m"] = turn.apply(pose["position_m"]).tolist()
    own = Rotation.from_quat(pose["quaternion"], scalar_first=True)
    pose["quaternion"] = (turn * own).as_quat(scalar_first=True).tolist()
