"""MJCF with one attribute at a time, by ``element@attribute``: for tests/model/test_mjcf_schema.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

Case = dict[str, Any]

TEMPLATE = """<mujoco><compiler {compiler}/><option {option}><flag {flag}/></option>
<asset><mesh name="m" vertex="0 0 0 .3 0 0 0 .2 0 0 0 .1"/><model name="arm" file="arm.xml"/>{in_asset}</asset>
<worldbody>{in_world}<body name="base" pos="0 0 1"><freejoint name="free" {freejoint}/>
 <inertial pos="0.01 0.02 0" mass="10" diaginertia="1 1.2 1.4"/><geom name="hull" type="box" size=".2 .2 .2"/>
 <site name="s" {site}/>
 <body name="l1" {body}><joint name="j1" {joint}/><inertial {inertial}/><geom name="g1" type="capsule" size=".05 .1"/>
  <body name="l2" pos=".3 0 0"><joint name="j2" axis="0 0 1"/><geom name="g2" {geom}/><geom size=".06" group="3"/>
   <site name="t2" pos=".2 0.1 0"/>{in_body}
   <body name="l3" pos=".2 0 0"><joint name="jb" type="ball"/><geom name="g3" size=".05" mass="1"/></body>
  </body></body></body></worldbody>
<tendon><fixed name="tf" {tendon_fixed}><joint joint="j1" coef="1"/><joint joint="j2" coef="-2"/></fixed>
 <spatial name="ts" {tendon_spatial}><site site="s"/><site site="t2"/></spatial>{in_tendon}</tendon>
<equality>{in_equality}</equality><contact><pair {pair}/><exclude {exclude}/></contact>
<actuator><motor name="m" {motor}/><general name="g" {general}/><motor name="jet" site="s" gear="1 0 0 0 0 1"/>{in_actuator}
</actuator><sensor>{in_sensor}</sensor>{top}</mujoco>"""
"""A base with two hinges and a ball joint, and a motor of each kind; ``arm.xml`` is attached only where a case does."""

ATTRIBUTES: dict[str, dict[str, str]] = {
    "compiler": {},
    "option": {"gravity": "0 0 0"},
    "option/flag": {},
    "body": {"pos": ".3 0 0"},
    "body/inertial": {"pos": "0.1 0 0.03", "mass": "2", "diaginertia": ".1 .12 .13"},
    "body/joint": {"axis": "0 1 0"},
    "body/freejoint": {},
    "body/geom": {"type": "capsule", "size": ".05 .1"},
    "body/site": {"pos": ".2 0 0"},
    "tendon/fixed": {},
    "tendon/spatial": {},
    "contact/pair": {"geom1": "g1", "geom2": "g3"},
    "contact/exclude": {"body1": "l1", "body2": "l3"},
    "actuator/motor": {"joint": "j1"},
    "actuator/general": {"joint": "j2"},
}
_TEXTS = (
    "in_asset",
    "in_world",
    "in_body",
    "in_tendon",
    "in_equality",
    "in_actuator",
    "in_sensor",
    "top",
)


def mjcf(**case: Any) -> str:
    """The scene with changed attributes of elements (None: removed) and inserted texts."""
    filled = {text: case.get(text, "") for text in _TEXTS}
    for path, attributes in ATTRIBUTES.items():
        slot = path.replace("tendon/", "tendon_").rpartition("/")[2]
        written = {**attributes, **case.get(path, {})}
        filled[slot] = " ".join(f'{name}="{value}"' for name, value in written.items() if value is not None)
    return TEMPLATE.format(**filled)


def written(folder: Path, text: str) -> Path:
    """Path of the scene, with the file beside it that it may attach."""
    (folder / "arm.xml").write_text(
        '<mujoco><worldbody><body name="arm"><joint/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    (folder / "robot.xml").write_text(text)
    return folder / "robot.xml"


def _cases(path: str, **values: str | dict[str, Any]) -> dict[str, Case]:
    """A case for each attribute: its value, or all changed attributes of the element, or of several elements."""
    found: dict[str, Case] = {}
    for attribute, value in values.items():
        if isinstance(value, str):
            found[f"{path}@{attribute}"] = {path: {attribute: value}}
        elif any("/" in key or key in ATTRIBUTES or key in _TEXTS for key in value):
            found[f"{path}@{attribute}"] = value
        else:
            found[f"{path}@{attribute}"] = {path: value}
    return found


def _servo_cases(kind: str, own: dict[str, str], **values: Any) -> dict[str, Case]:
    """A case for each attribute of a servo beside what its kind needs: its value, or all that go with it; None: no case."""
    found = {}
    for attribute, value in values.items():
        if value is None:
            continue
        given = {"joint": "j2", **own} | ({attribute: value} if isinstance(value, str) else value)
        written = " ".join(f'{name}="{each}"' for name, each in given.items() if each is not None)
        found[f"actuator/{kind}@{attribute}"] = {"in_actuator": f'<{kind} name="probe" {written}/>'}
    return found


_TURNED = {"quat": "1 .2 .3 .4", "axisangle": "1 0 1 40", "euler": "10 20 30", "xyaxes": "1 1 0 0 0 1", "zaxis": "1 0 1"}
_SOFT = {"solref": "0.1 1", "solimp": ".1 .2 .3"}
_SOFT_JOINT = {"solimpfriction": ".1 .2 .3", "solimplimit": ".1 .2 .3", "solreffriction": ".1 1", "solreflimit": ".1 1"}
_GRAVITY = {"option": {"gravity": "0 0 -9"}}
_FLUID = {"option": {"gravity": "0 0 0", "density": "100"}}
_CRANK = {"joint": None, "cranksite": "t2", "slidersite": "s", "cranklength": "1"}
_TRANSMISSIONS: dict[str, Any] = {
    "jointinparent": {"joint": None, "jointinparent": "jb", "gear": "1 0 2"},
    "tendon": {"joint": None, "tendon": "tf"},
    "site": {"joint": None, "site": "t2", "gear": "1 0 2 0 1 0"},
    "refsite": {"joint": None, "site": "t2", "refsite": "s", "gear": "1 0 2 0 1 0"},
    **dict.fromkeys(("cranksite", "slidersite", "cranklength"), _CRANK),
}
_MOTOR: dict[str, Any] = {
    **_TRANSMISSIONS,
    "joint": "j2",
    "gear": "3",
    "ctrlrange": "-1 1",
    "ctrllimited": {"ctrllimited": "true", "ctrlrange": "-1 1"},
    "forcerange": "-1 1",
    "forcelimited": {"forcelimited": "true", "forcerange": "-1 1"},
    "armature": "0.2",
    "damping": "0.5 0.1 0.2",
    "group": "3",
    "lengthrange": "-1 1",
    "user": "1 2",
}
SERVOS: dict[str, dict[str, str]] = {
    "position": {"kp": "3"},
    "velocity": {"kv": "3"},
    "damper": {"kv": "3", "ctrlrange": "0 1"},
    "intvelocity": {"kp": "3", "actrange": "-2 2"},
    "cylinder": {"area": "1", "bias": "1 1 1"},
    "muscle": {"lengthrange": "-9 9"},
    "dcmotor": {"motorconst": "0.1", "resistance": "1"},
    "pid": {"kp": "3"},
}
"""Servos by their elements, with what each of them needs."""
_IDLE = {"group": "3", "lengthrange": "-1 1", "user": "1 2"}
_IDLE_MUSCLE = {"group": "3", "user": "1 2"}
_WITHIN: dict[str, Any] = _MOTOR | dict.fromkeys(_IDLE, _IDLE) | {"site": _TRANSMISSIONS["refsite"]}
"""The same of servos, which act between two links."""
_TENDON: dict[str, Any] = {
    "armature": "0.3",
    "stiffness": "3 1 2",
    "damping": "0.4 0.1",
    "springlength": {"stiffness": "3", "springlength": "0.1 0.2"},
    "actuatorfrclimited": "false",
    "frictionloss": "1",
    "range": "-9 9",
    "limited": {"limited": "true", "range": "-9 9"},
    "margin": "0.1",
    **_SOFT_JOINT,
    "group": "2",
    "user": "1",
}

COMPARED: dict[str, Case] = {
    **_cases(
        "compiler",
        alignfree="true",
        angle={"compiler": {"angle": "radian"}, "body/joint": {"ref": "1"}},
        autolimits="false",
        balanceinertia={"compiler": {"balanceinertia": "true"}, "body/inertial": {"diaginertia": ".1 .1 .5"}},
        boundinertia="0.2",
        boundmass="3",
        coordinate="local",
        discardvisual="true",
        eulerseq={"compiler": {"eulerseq": "zyx"}, "body": {"euler": "10 20 30"}},
        fusestatic={"compiler": {"fusestatic": "true"}, "in_body": '<body pos=".1 0 0"><geom size=".05"/></body>'},
        inertiafromgeom="true",
        inertiagrouprange="0 1",
        passthrough="none",
        savecanonical="true",
        savecompiled="true",
        saveinertial="true",
        usethread="false",
    ),
    **_cases(
        "option",
        gravity="0 0 -9",
        magnetic="1 2 3",
        timestep="0.1",
        ccd_iterations="3",
        ccd_tolerance="1e-3",
        cone="elliptic",
        impratio="3",
        iterations="3",
        jacobian="dense",
        ls_iterations="3",
        ls_tolerance="0.1",
        noslip_iterations="3",
        noslip_tolerance="0.1",
        o_friction="1 1 1 1 1",
        o_margin="1",
        o_solimp=".1 .2 .3",
        o_solref=".1 1",
        sdf_initpoints="3",
        sdf_iterations="3",
        sleep_tolerance="1",
        solver="CG",
        tolerance="0.1",
    ),
    **_cases(
        "option/flag",
        gravity={"option": {"gravity": "0 0 -9"}, "option/flag": {"gravity": "disable"}},
        **dict.fromkeys(
            ("autoreset", "eulerdamp", "island", "midphase", "nativeccd", "refsafe", "sensor", "warmstart", "ipc"), "disable"
        ),
        **dict.fromkeys(
            ("diagexact", "energy", "fwdinv", "invdiscrete", "multiccd", "override", "sleep", "speculative"), "enable"
        ),
    ),
    **_cases(
        "body",
        pos=".1 .2 .3",
        **_TURNED,
        fuse="false",
        gravcomp={**_GRAVITY, "body": {"gravcomp": "1"}},
        mocap={"in_world": '<body name="mc" mocap="true" pos="3 0 0"><geom size=".1"/></body>'},
        simple="false",
        sleep={"in_world": ""},
        user="1",
    ),
    **_cases(
        "body/inertial",
        mass="3",
        pos="0 0 0",
        **_TURNED,
        diaginertia=".2 .2 .2",
        fullinertia={"diaginertia": None, "fullinertia": ".1 .12 .13 .01 .02 .03"},
    ),
    **_cases(
        "body/joint",
        type="slide",
        axis="0 1 1",
        pos=".1 .2 .3",
        ref="30",
        springref={"stiffness": "3", "springref": "20"},
        armature="0.3",
        stiffness="1 2 3",
        damping="1 2 3",
        springdamper="0.1 1",
        range="-1 1",
        limited={"limited": "true", "range": "-1 1"},
        actuatorfrcrange="-1 1",
        actuatorfrclimited={"actuatorfrclimited": "true", "actuatorfrcrange": "-1 1"},
        actuatorgravcomp={**_GRAVITY, "body": {"gravcomp": "1"}, "body/joint": {"actuatorgravcomp": "true"}},
        frictionloss="1",
        margin={"margin": "0.1", "range": "-1 1"},
        **_SOFT_JOINT,
        group="2",
        user="1",
    ),
    **_cases("body/freejoint", align="true", group="2"),
    **_cases(
        "body/geom",
        type={"type": "box", "size": ".1 .2 .3"},
        pos=".1 .2 .3",
        **_TURNED,
        size=".1 .2",
        fromto={"fromto": "0 0 0 0 .1 .3", "size": ".05"},
        mesh={"type": "mesh", "mesh": "m", "size": None},
        fitscale={"type": "box", "mesh": "m", "fitscale": "2", "size": None},
        mass="3",
        density="10",
        shellinertia="true",
        contype="2",
        conaffinity="2",
        fluidshape={**_FLUID, "body/geom": {"fluidshape": "ellipsoid"}},
        fluidcoef={**_FLUID, "body/geom": {"fluidshape": "ellipsoid", "fluidcoef": ".1 .2 .3 .4 .5"}},
        condim="1",
        friction=".1",
        gap=".1",
        margin=".1",
        priority="1",
        solmix="2",
        **_SOFT,
        castshadow="false",
        group="2",
        material={"in_asset": '<material name="red"/>', "body/geom": {"material": "red"}},
        rgba="1 0 0 1",
        user="1",
    ),
    **_cases(
        "body/site",
        pos=".1 .2 .3",
        **_TURNED,
        fromto={"pos": None, "fromto": "0 0 0 0 .1 .3", "size": ".05", "type": "capsule"},
        size=".1",
        type="box",
        mesh={"mesh": "m", "type": "mesh"},
        group="2",
        material={"in_asset": '<material name="red"/>', "body/site": {"material": "red"}},
        rgba="1 0 0 1",
        user="1",
    ),
    **_cases("tendon/fixed", **_TENDON),
    **_cases(
        "tendon/spatial",
        **_TENDON,
        material={"in_asset": '<material name="red"/>', "tendon/spatial": {"material": "red"}},
        rgba="1 0 0 1",
        width=".1",
    ),
    **_cases("contact/exclude", body1="l2", body2="l2"),
    **_cases(
        "contact/pair",
        geom1="g2",
        geom2="hull",
        condim="1",
        friction=".1",
        gap=".1",
        margin=".1",
        solreffriction=".1 1",
        **_SOFT,
    ),
    **_cases("actuator/motor", **_MOTOR),
    **_servo_cases("position", SERVOS["position"], **_WITHIN, kp="2", kv="1", dampratio="1"),
    **_servo_cases("position", SERVOS["position"], timeconst="0.1"),
    **_servo_cases(
        "intvelocity",
        SERVOS["intvelocity"],
        **_WITHIN,
        kp="2",
        kv="1",
        dampratio="1",
        actrange="-1 1",
        actlimited="true",
    ),
    "actuator/intvelocity@inheritrange": {
        "body/joint": {"range": "-1 1"},
        "in_actuator": '<intvelocity name="probe" joint="j1" kp="3" inheritrange="1"/>',
    },
    **_servo_cases("cylinder", SERVOS["cylinder"], **_WITHIN, area="2", bias="1 2 3", diameter="2", timeconst="2"),
    **_servo_cases(
        "muscle",
        SERVOS["muscle"],
        **{name: value for name, value in _WITHIN.items() if name not in ("site", "refsite", *_IDLE)},
        group=_IDLE_MUSCLE,
        user=_IDLE_MUSCLE,
        **dict.fromkeys(("scale", "vmax", "fpmax", "fvmax", "lmax", "force"), "1.1"),
        lmin="0.6",
        lengthrange="-8 9",
        range="0.7 1.1",
        timeconst="0.02 0.05",
        tausmooth="0.1",
    ),
    **_servo_cases(
        "dcmotor",
        SERVOS["dcmotor"],
        **{name: value for name, value in _WITHIN.items() if name not in ("forcerange", "forcelimited")},
        motorconst="0.2",
        resistance="2",
        cogging="0.1 6 0",
        controller={"controller": "1 1 1", "input": "pos"},
        inductance="0.01",
        input={"controller": "1 1 1", "input": "pos vel ff voltage"},
        lugre="1 1 1 1 1",
        nominal={"motorconst": None, "resistance": None, "nominal": "12 1 100"},
        saturation="1 1",
        thermal="1 1 1 1 1 1",
    ),
    **_servo_cases(
        "pid",
        SERVOS["pid"],
        **_WITHIN,
        kp="2",
        kv="1",
        dampratio="1",
        ki="2",
        imax={"ki": "2", "imax": "0.1"},
        slewmax="1e-9",
        input="vel ff",
        posrange="-1 1",
        velrange="-1 1",
        ffrange={"input": "pos vel ff", "ffrange": "-1 1"},
    ),
    "actuator/pid@inheritrange": {
        "body/joint": {"range": "-1 1"},
        "in_actuator": '<pid name="probe" joint="j1" kp="3" inheritrange="1"/>',
    },
    "actuator/position@inheritrange": {
        "body/joint": {"range": "-1 1"},
        "in_actuator": '<position name="probe" joint="j1" kp="3" inheritrange="1"/>',
    },
    **_servo_cases("velocity", SERVOS["velocity"], **_WITHIN, kv="2"),
    **_servo_cases("damper", SERVOS["damper"], **(_WITHIN | {"ctrlrange": "0 2"} | {"ctrllimited": None}), kv="2"),
    **_cases(
        "actuator/general",
        **(_MOTOR | {"joint": "j1"}),
        gainprm="2",
        gaintype={"gaintype": "affine", "gainprm": "1 1 1"},
        biastype={"biastype": "affine", "biasprm": "1 1 1"},
        biasprm={"biastype": "affine", "biasprm": "1 2 3"},
        actdim="-1",
        actearly="true",
        actlimited={"dyntype": "integrator", "actlimited": "true", "actrange": "-1 1"},
        actrange={"dyntype": "integrator", "actrange": "-1 1"},
        dyntype={"dyntype": "filter", "dynprm": "0.1"},
        dynprm={"dyntype": "filter", "dynprm": "0.1"},
        ffrange="-1 1",
        inheritrange="0",
        input="pos",
        velrange="-1 1",
    ),
}
"""Cases whose forces are those of MuJoCo's own compile of the file."""

_SIMULATOR = (
    *("timestep", "ccd_iterations", "ccd_tolerance", "cone", "impratio", "iterations", "jacobian", "ls_iterations"),
    *("ls_tolerance", "noslip_iterations", "noslip_tolerance", "o_friction", "o_margin", "o_solimp", "o_solref"),
    *("sdf_initpoints", "sdf_iterations", "sleep_tolerance", "solver", "tolerance"),
)
_CONTACT = ("condim", "friction", "gap", "margin", "solimp", "solref")
LEFT_OUT = {
    *(f"option@{each}" for each in _SIMULATOR),
    *(f"body/geom@{each}" for each in (*_CONTACT, "priority", "solmix")),
    *(f"contact/pair@{each}" for each in (*_CONTACT, "solreffriction")),
}
"""Noted attributes that change no force."""

WITHOUT_FORCE = {
    *(f"compiler@{each}" for each in ("alignfree", "autolimits", "coordinate", "discardvisual")),
    *("option@magnetic", "option/flag@gravity", "body@fuse", "body/freejoint@align"),
    *(f"tendon/{kind}@{each}" for kind in ("fixed", "spatial") for each in ("range", "limited", "frictionloss")),
    *("body/joint@range", "body/joint@limited", "body/joint@frictionloss", "body/geom@contype", "body/geom@conaffinity"),
    *(f"body/site@{each}" for each in ("size", "type", "mesh")),
    *(f"contact/{each}" for each in ("exclude@body1", "exclude@body2", "pair@geom1", "pair@geom2")),
}
"""Modelled attributes that change neither masses nor forces, or not those of a base with an arm."""

_FLEX = '<flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" dim="2" mass="1" rigid="true"/>'
_PLUGIN = '<plugin plugin="x"/>'
_TENDON_FORCES: dict[str, Any] = {"springyield": {"stiffness": "1", "springyield": "0.1"}}


def _sensor(kind: str, attributes: str) -> dict[str, Case]:
    return {f"sensor/{kind}": {"in_sensor": f'<{kind} name="probe" {attributes}/>'}}


def _servo(kind: str, attributes: str) -> dict[str, Case]:
    return {f"actuator/{kind}": {"in_actuator": f"<{kind} {attributes}/>"}}


MARKED: dict[str, Case] = {
    **_cases("compiler", settotalmass="12"),
    "compiler@fitaabb": {"compiler": {"fitaabb": "true"}, "body/geom": {"type": "box", "mesh": "m", "size": None}},
    "compiler@conflict": {
        "compiler": {"conflict": "merge"},
        "in_body": '<attach model="arm" body="arm" prefix="a_"/>',
    },
    **_cases("option", density="1", viscosity="1", wind="1 0 0", integrator="Euler"),
    **{where: COMPARED[where] for where in LEFT_OUT},
    "option@actuatorgroupdisable": {"option": {"actuatorgroupdisable": "3"}, "actuator/motor": {"group": "3"}},
    **_cases(
        "option/flag",
        actuation="disable",
        clampctrl={"option/flag": {"clampctrl": "disable"}, "actuator/motor": {"ctrlrange": "-1 1"}},
        constraint={"option/flag": {"constraint": "disable"}, "body/joint": {"frictionloss": "1"}},
        damper={"option/flag": {"damper": "disable"}, "body/joint": {"damping": "1"}},
        equality={"option/flag": {"equality": "disable"}, "in_equality": '<weld body1="l1" body2="l3"/>'},
        frictionloss={"option/flag": {"frictionloss": "disable"}, "body/joint": {"frictionloss": "1"}},
        spring={"option/flag": {"spring": "disable"}, "body/joint": {"stiffness": "1"}},
        contact="disable",
        filterparent="disable",
        limit={"option/flag": {"limit": "disable"}, "body/joint": {"range": "-1 1"}},
    ),
    "extension": {"top": f"<extension>{_PLUGIN}</extension>"},
    "body/plugin": {"in_body": _PLUGIN},
    "body/geom/plugin": {"in_body": f'<geom size=".1">{_PLUGIN}</geom>'},
    "body/flexcomp": {"in_body": _FLEX},
    "deformable/flex": {
        "top": '<deformable><flex name="f" dim="2" body="l2" vertex="0 0 0 1 0 0 0 1 0" element="0 1 2"/></deformable>'
    },
    "asset/mesh/plugin": {"in_asset": f'<mesh name="x">{_PLUGIN}</mesh>'},
    "actuator/plugin": {"in_actuator": _PLUGIN},
    "sensor/plugin": {"in_sensor": _PLUGIN},
    **_cases("body/joint", springyield={"stiffness": "3", "springyield": "0.1"}),
    **_cases("body/geom", adhesion="1", surfacevel="1 0 0 0 0 0"),
    **_cases("contact/pair", adhesion="1"),
    **{
        case: each
        for kind, name in (("fixed", "tf"), ("spatial", "ts"))
        for case, each in _cases(
            f"tendon/{kind}",
            **_TENDON_FORCES,
            actuatorfrcrange={
                f"tendon/{kind}": {"actuatorfrcrange": "-1 1"},
                "in_actuator": f'<motor tendon="{name}"/>',
            },
        ).items()
    },
    "equality/flex": {"in_equality": '<flex flex="f"/>', "in_body": _FLEX},
    "equality/flexstrain": {"in_equality": '<flexstrain flex="f"/>', "in_body": _FLEX},
    **{
        case: each
        for kind in ("motor", "general")
        for case, each in _cases(f"actuator/{kind}", interp={"delay": "0.01", "nsample": "20", "interp": "linear"}).items()
    },
    **{
        case: each
        for kind, own in SERVOS.items()
        for case, each in _servo_cases(kind, own, interp={"delay": "0.01", "nsample": "20", "interp": "linear"}).items()
    },
    **_cases(
        "actuator/general",
        body={"in_actuator": '<general name="probe" body="l2" ctrlrange="0 1"/>'},
    ),
    **_servo("adhesion", 'name="probe" body="l2" ctrlrange="0 1"'),
    **_servo("orientation", 'name="probe" joint="jb" kp="3"'),
    "sensor/rangefinder@camera": {
        "in_body": '<camera name="c" resolution="2 2"/>',
        "in_sensor": '<rangefinder camera="c"/>',
    },
    "sensor/rangefinder@data": {"in_sensor": '<rangefinder site="s" data="dist normal"/>'},
    "sensor/gyro@interp": {"in_sensor": '<gyro site="s" delay="0.01" nsample="20" interp="linear"/>'},
    "sensor/camprojection": {
        "in_body": '<camera name="c" resolution="2 2"/>',
        "in_sensor": '<camprojection name="probe" site="s" camera="c"/>',
    },
    **{
        f"sensor/{what}limit{kind}": {
            "body/joint": {"range": "-1 1"},
            "tendon/fixed": {"range": "-1 1"},
            "in_sensor": f'<{what}limit{kind} name="probe" {what}="{name}"/>',
        }
        for what, name in (("joint", "j1"), ("tendon", "tf"))
        for kind in ("pos", "vel", "frc")
    },
    **_sensor("insidesite", 'objtype="site" objname="t2" site="s"'),
    **_sensor("distance", 'geom1="g1" geom2="g2"'),
    **_sensor("normal", 'geom1="g1" geom2="g2"'),
    **_sensor("fromto", 'geom1="g1" geom2="g2"'),
    **_sensor("contact", 'geom1="g1"'),
    **_sensor("e_potential", ""),
    **_sensor("tactile", 'geom="g2" mesh="m"'),
    **_sensor("user", 'dim="1"'),
}
"""Cases that are refused or noted by name."""
