"""MJCF written by hand, a case for each thing that such a file can say: the dynamics equal MuJoCo's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

import leastaction
from leastaction.errors import ArgumentError, ModelFileError
from leastaction.io.mechanisms import Model
from leastaction.mechanics import MidpointVI
from leastaction.systems import MidpointSystem, Oriented
from oracles import mujoco_models

CUBE = (
    'vertex="0 0 0  .3 0 0  .3 .2 0  0 .2 0  0 0 .1  .3 0 .1  .3 .2 .1  0 .2 .1" '
    'face="0 2 1 0 3 2 4 5 6 4 6 7 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6 3 0 4 3 4 7"'
)
# Two boxes that stand apart: what is between them counts in the legacy sum only.
HOLLOW = (
    'vertex="0 0 0  .3 0 0  .3 .2 0  0 .2 0  0 0 .1  .3 0 .1  .3 .2 .1  .1 .1 .05" '
    'face="0 2 1 0 3 2 4 5 7 5 6 7 0 1 5 0 5 4 1 2 6 1 6 5 2 3 6 6 3 7 3 0 4 3 4 7"'
)


def body(inside: str, **more: str) -> str:
    """Return an MJCF of one body on a hinge that nothing is special about, with something in it."""
    attributes = " ".join(f'{name}="{value}"' for name, value in more.items())
    joint = '<joint name="j" axis="1 2 3" pos=".1 .2 .3"/>'
    return f'<worldbody><body name="b" {attributes}>{joint}{inside}</body></worldbody>'


INERTIAL = '<inertial pos="0.1 0 .2" mass="2" diaginertia=".1 .2 .25"/>'
CASES = {
    "a hinge off the origin": body(INERTIAL, pos="1 2 3", quat="1 2 3 4"),
    "a slide": f'<worldbody><body euler="30 40 50"><joint type="slide" axis="0 3 4"/>{INERTIAL}</body></worldbody>',
    "a reference and a spring": (
        '<worldbody><body><joint ref="30" springref="-20" stiffness="3" damping=".7" axis="0 1 1" pos="0 0 1"/>'
        f'{INERTIAL}<body pos="0 0 1"><joint type="slide" ref=".3" springref=".2" stiffness="5" axis="1 0 0"/>'
        f"{INERTIAL}"
        "</body></body></worldbody>"
    ),
    "radians": (
        '<compiler angle="radian"/><worldbody><body euler=".1 .2 .3"><joint ref=".5" springref="-.2" stiffness="3"/>'
        f"{INERTIAL}</body></worldbody>"
    ),
    "another sequence of angles": '<compiler eulerseq="zyx"/>' + body(INERTIAL, euler="10 20 30"),
    "angles about fixed axes": '<compiler eulerseq="XYZ"/>' + body(INERTIAL, euler="10 20 30"),
    "an axis and an angle": body(INERTIAL, axisangle="1 2 -3 40"),
    "two axes": body(INERTIAL, xyaxes="1 2 3 0 1 0"),
    "the z axis": body(INERTIAL, zaxis="1 2 3"),
    "several joints in a body": (
        '<worldbody><body pos="1 0 0" euler="0 30 0"><joint type="slide" axis="1 1 0"/>'
        '<joint axis="0 1 0" pos="0 0 .5"/>'
        f'<joint axis="1 0 1" pos=".2 .1 0" ref="20"/>{INERTIAL}</body></worldbody>'
    ),
    "frames around bodies, joints and geoms": (
        '<worldbody><frame pos="1 2 3" euler="10 20 30"><frame quat="1 1 0 0"><body pos="0 0 1">'
        '<frame pos=".1 .2 .3" euler="40 0 0"><joint axis="0 1 0" pos="0 0 .2"/><geom size=".1" pos=".3 0 0"/></frame>'
        '<frame pos="0 .2 0" axisangle="1 0 0 30"><body><joint axis="1 1 0"/><geom type="box" size=".1 .2 .3"/></body>'
        "</frame></body></frame></frame></worldbody>"
    ),
    "a ball joint": f'<worldbody><body pos="0 0 1" euler="0 30 0"><joint type="ball"/>{INERTIAL}</body></worldbody>',
    "a ball joint off the origin": (
        f'<worldbody><body pos="0 0 1"><joint type="ball" pos=".2 .3 .1"/>{INERTIAL}<body pos="0 1 0">'
        f'<joint type="ball" pos="0 0 .5"/>{INERTIAL}</body></body></worldbody>'
    ),
    "a free joint": (
        f'<worldbody><body pos="0 0 1" euler="0 30 0"><freejoint/>{INERTIAL}<body pos="0 1 0"><joint axis="1 0 0"/>'
        f"{INERTIAL}</body></body></worldbody>"
    ),
    "what ball joints have": (
        '<worldbody><body pos="0 0 1" euler="20 30 0"><joint type="ball" pos=".1 0 .2" damping=".3" stiffness="2" '
        f'armature=".05" frictionloss=".1" range="0 60"/>{INERTIAL}<body pos="0 1 0" euler="0 0 40">'
        f'<joint type="ball" damping=".2" stiffness="1.5"/>{INERTIAL}</body></body></worldbody>'
    ),
    "what a free joint has": (
        f'<worldbody><body pos="0 0 1" euler="0 30 0"><joint type="free" damping=".3" armature=".2"/>{INERTIAL}'
        f'<body pos="0 1 0"><joint axis="1 0 0"/>{INERTIAL}</body></body></worldbody>'
    ),
    "a turned inertial": body('<inertial pos="0 .1 .2" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'),
    "a full inertia": body('<inertial pos="0 .1 .2" mass="2" fullinertia=".1 .2 .25 .01 -.02 .03"/>'),
    "spheres": body('<geom size=".1" pos="1 0 0"/><geom size=".2" mass="3" pos="0 1 0"/>'),
    "every primitive": body(
        '<geom type="capsule" size=".1 .3" euler="10 20 30"/><geom type="cylinder" size=".2 .3" pos="1 0 0"/>'
        '<geom type="box" size=".1 .2 .3" pos="0 1 0" density="500"/><geom type="ellipsoid" size=".1 .2 .3" mass="4"/>'
    ),
    "every primitive's shell": body(
        '<geom type="capsule" size=".1 .3" euler="10 20 30" shellinertia="true"/>'
        '<geom type="cylinder" size=".2 .3" pos="1 0 0" shellinertia="true"/><geom size=".3" shellinertia="true"/>'
        '<geom type="box" size=".1 .2 .3" pos="0 1 0" mass="5" shellinertia="true"/>'
    ),
    "from a point to another": body(
        '<geom type="capsule" size=".1" fromto="0 0 0 1 2 3"/><geom type="cylinder" size=".2" fromto="0 1 0 1 1 0"/>'
        '<geom type="box" size=".1" fromto="0 1 0 1 1 -1"/><geom type="ellipsoid" size=".1" fromto="0 0 0 0 0 -1"/>'
    ),
    "planes weigh nothing": body('<geom type="sphere" size=".1" pos="0 1 0"/>')
    + '<worldbody><geom type="plane" size="1 1 1"/></worldbody>',
    "groups that count": '<compiler inertiagrouprange="1 2"/>'
    + body('<geom size=".1" group="0" pos="1 0 0"/><geom size=".1" group="2" pos="0 1 0"/>'),
    "geoms before inertials": '<compiler inertiafromgeom="true"/>' + body(INERTIAL + '<geom size=".1" pos="0 0 1"/>'),
    "geoms before inertials, and there are none": '<compiler inertiafromgeom="true"/>' + body(INERTIAL),
    "least mass and inertia": '<compiler boundmass="1" boundinertia=".12"/>'
    + body('<inertial pos="1 0 0" mass=".5" diaginertia=".1 .11 .2"/><body pos="0 1 0"/>'),
    "balanced inertia": '<compiler balanceinertia="true"/>'
    + body('<inertial pos="0 1 0" mass="1" diaginertia=".1 .1 .3"/>'),
    "all of a given mass": '<compiler settotalmass="7"/>'
    + body(INERTIAL + f'<body pos="0 0 1"><joint/>{INERTIAL}</body>'),
    "defaults in defaults": (
        '<default><geom density="700"/><joint damping=".1"/><default class="a"><joint axis="0 1 0" damping=".2"/>'
        '<default class="c"><geom type="box" size=".1 .2 .3"/><joint type="slide"/></default></default></default>'
        '<worldbody><body childclass="a"><joint/><geom size=".1"/><body pos="0 0 1" childclass="c"><joint/><geom/>'
        '<body><joint class="a"/><geom class="main" size=".2" pos="1 0 0"/></body></body></body></worldbody>'
    ),
    "copies": (
        '<worldbody><replicate count="3" euler="0 0 30" offset="0 .1 0" sep="-"><body name="r" pos="1 0 0">'
        '<joint name="j" axis="0 1 0"/><geom size=".1" pos="0 0 .2"/></body></replicate></worldbody>'
    ),
    "weight that is taken off": body(INERTIAL, gravcomp=".6"),
    "another gravity": '<option gravity="1 2 -3"/>' + body(INERTIAL),
    "no gravity": '<option><flag gravity="disable"/></option>'
    + body(f'{INERTIAL}<body pos="0 0 1"><joint axis="1 0 0"/>{INERTIAL}</body>'),
    "damping by odd powers": f'<worldbody><body><joint damping=".5 0 .3"/>{INERTIAL}</body></worldbody>',
    "springs that settle in some time": (
        '<worldbody><body><joint ref="30" springref="-20" springdamper=".4 .7" axis="0 1 1" pos="0 0 1"/>'
        f'{INERTIAL}<body pos="0 0 1"><joint type="slide" springdamper=".2 1" axis="1 0 0"/>{INERTIAL}'
        "</body></body></worldbody>"
    ),
    "a mesh": f'<asset><mesh name="m" {CUBE} inertia="exact"/></asset>'
    + body('<geom type="mesh" mesh="m" pos="1 0 0"/>'),
    "a mesh by its hull": f'<asset><mesh name="m" {HOLLOW} inertia="convex"/></asset>'
    + body('<geom type="mesh" mesh="m" euler="10 20 30"/>'),
    "a mesh in the old way": f'<asset><mesh name="m" {HOLLOW} inertia="legacy"/></asset>'
    + body('<geom type="mesh" mesh="m" pos="0 1 0" mass="3"/><geom type="mesh" mesh="m"/>'),
    "a mesh's shell": f'<asset><mesh name="m" {HOLLOW} inertia="shell"/></asset>'
    + body('<geom type="mesh" mesh="m"/>'),
    "a mesh scaled and moved": f'<asset><mesh name="m" {CUBE} inertia="exact" scale="1 2 .5" refpos=".1 .2 .3" '
    'refquat="1 1 0 0"/></asset>' + body('<geom type="mesh" mesh="m" pos="1 0 0" euler="0 90 0"/>'),
    "a mesh mirrored": f'<asset><mesh name="m" {CUBE} inertia="exact" scale="1 -1 1"/></asset>'
    + body('<geom type="mesh" mesh="m" pos="1 0 0"/>'),
    "no names at all": (
        f'<worldbody><body><joint/><joint axis="1 0 0"/>{INERTIAL}<body pos="1 0 0"><joint/>{INERTIAL}</body>'
        f'<body pos="0 1 0"><joint type="ball"/>{INERTIAL}</body></body><body><freejoint/>{INERTIAL}</body></worldbody>'
    ),
}


def written(folder: Path, text: str) -> Path:
    file = folder / "model.xml"
    file.write_text(f'<mujoco model="by hand">{text}</mujoco>')
    return file


def loaded(folder: Path, text: str, **options: object) -> Model:
    return leastaction.load(written(folder, text), **options)  # type: ignore[arg-type]


@pytest.mark.filterwarnings("ignore:.*settotalmass:UserWarning")  # MuJoCo's, where it compiles
@pytest.mark.parametrize("case", CASES)
def test_dynamics_equal_those_of_mujoco(case: str, tmp_path: Path) -> None:
    model = loaded(tmp_path, CASES[case])
    worst = mujoco_models.errors(tmp_path / "model.xml", model)
    assert max(worst.values()) < (3e-8 if "mesh" in case else 1e-12), worst  # MuJoCo's meshes are in single precision


def test_parts_of_other_files_keep_their_own_units(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(
        '<mujoco model="arm"><compiler angle="radian"/><default><joint damping=".3"/></default><worldbody>'
        f'<body name="link" euler=".1 .2 .3"><joint name="j" ref=".5" range="-1 1"/>{INERTIAL}<site name="tip"/></body>'
        "</worldbody></mujoco>"
    )
    (tmp_path / "more.xml").write_text(
        f'<mujocoinclude><body name="more" pos="0 1 0"><joint name="m"/>{INERTIAL}</body></mujocoinclude>'
    )
    text = (
        '<asset><model name="arm" file="arm.xml"/></asset><worldbody><frame euler="0 0 40"><attach model="arm" '
        'body="link" prefix="left-"/></frame><frame pos="0 1 0">'
        '<attach model="arm" body="link" prefix="right-"/></frame>'
        '<include file="more.xml"/></worldbody>'
    )
    model = loaded(tmp_path, text)
    assert model.mechanism.variables == ("left-j", "right-j", "m")
    assert "right-tip" in model.mechanism.frames
    assert max(mujoco_models.errors(tmp_path / "model.xml", model).values()) < 1e-12
    bounds = {bound.names: (bound.min, bound.max) for bound in model.limits}  # type: ignore[attr-defined]
    assert bounds["left-j"] == (-1.0, 1.0)


def test_limits_are_in_radians_and_say_what_of(tmp_path: Path) -> None:
    text = (
        '<worldbody><body><joint name="a" range="-90 45"/><joint name="b" type="slide" range="-1 2" axis="1 0 0"/>'
        f'<joint name="c" range="-90 45" limited="false"/>{INERTIAL}</body></worldbody>'
        '<actuator><motor name="m" joint="a" gear="3" ctrlrange="-2 2"/></actuator>'
    )
    model = loaded(tmp_path, text)
    found = {(bound.names, bound.of): (bound.min, bound.max) for bound in model.limits}  # type: ignore[attr-defined]
    assert found == {
        ("a", "variable"): (-np.pi / 2, np.pi / 4),
        ("b", "variable"): (-1.0, 2.0),
        ("m", "input"): (-2.0, 2.0),
    }
    assert leastaction.load(tmp_path / "model.xml", motors=False).mechanism.inputs == ()
    assert leastaction.load(tmp_path / "model.xml", motors=["b"]).mechanism.inputs == ("b.force",)
    none = loaded(
        tmp_path, '<compiler autolimits="false"/>' + body(INERTIAL).replace('name="j"', 'name="j" range="-1 1"')
    )
    assert none.limits == ()


def test_keyframes_are_by_variable(tmp_path: Path) -> None:
    import mujoco

    text = (
        f'<worldbody><body name="base" pos="0 0 1"><freejoint name="root"/>{INERTIAL}<body name="arm"><joint name="j"/>'
        f'{INERTIAL}<body><joint name="ball" type="ball"/>{INERTIAL}<site name="tip" pos="1 2 3"/></body></body></body>'
        '</worldbody><keyframe><key name="home" qpos="1 2 3 .5 .5 -.1 .4 .7 .8 .2 .3 .4" '
        'qvel="1 2 3 .1 .2 .3 4 .5 .6 .7" ctrl="5"/><key qpos="0 0 0 1 0 0 0 0 1 0 0 0"/></keyframe>'
        '<actuator><motor name="m" joint="j"/></actuator>'
    )
    model = loaded(tmp_path, text)
    key = model.keyframes["home"]
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    d = mujoco.MjData(m)
    mujoco.mj_resetDataKeyframe(m, d, 0)
    mujoco.mj_forward(m, d)
    q, v = model.mechanism.configuration(key.q), model.mechanism.velocity(key.v)
    np.testing.assert_allclose(model.mechanism.frame_pose(q, "tip")[:3, 3], d.site("tip").xpos, atol=1e-12)
    twist = np.zeros(6)
    mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_SITE, 0, twist, 0)
    np.testing.assert_allclose(model.mechanism.frame_velocity(q, v, "tip")[:3], twist[3:], atol=1e-12)
    assert key.inputs == {"m": 5.0}
    assert set(model.keyframes) == {"home", "key1"}
    assert model.reference["root.z"] == 1.0
    assert [key.q[f"root.q{letter}"] for letter in "wxyz"] == pytest.approx(
        np.array([0.5, 0.5, -0.1, 0.4]) / np.sqrt(0.67)
    )
    # By angles it is the same place and velocity.
    angles = loaded(tmp_path, text, axes="xyz")
    other, w = angles.keyframes["home"], angles.mechanism
    assert w.variables[3:6] == ("root.rx", "root.ry", "root.rz")
    q, v = w.configuration(other.q), w.velocity(other.v)
    np.testing.assert_allclose(w.frame_pose(q, "tip")[:3, 3], d.site("tip").xpos, atol=1e-12)
    np.testing.assert_allclose(w.frame_velocity(q, v, "tip")[:3], twist[3:], atol=1e-12)


def test_what_ball_and_free_joints_have(tmp_path: Path) -> None:
    model = loaded(tmp_path, CASES["what ball joints have"])
    assert model.left_out == ()
    first = model.mechanism.tree.rotations[0].name
    assert {f"spring.{first}.w{x}" for x in "xyz"} | {f"friction.{first}.w{x}" for x in "xyz"} <= set(
        model.mechanism.elements
    )
    (cone,) = model.limits
    assert isinstance(cone, Oriented)
    assert cone.within == pytest.approx(np.radians(60.0))
    system = MidpointSystem(MidpointVI(model.mechanism), np.linspace(0.0, 0.1, 3))
    (rows,) = cone.rows(system, 0)
    x = np.tile(system.integrator.start(model.mechanism.configuration(model.reference)).x, (3, 1))
    at = model.mechanism.coordinates.index(f"{first}.qw")
    x[1, at : at + 4] = np.cos(np.radians(30.0)), 0.0, np.sin(np.radians(30.0)), 0.0  # on the cone
    assert rows.values(x, np.zeros((2, system.nu)))[1] == pytest.approx(0.0, abs=1e-12)
    # Of angles only hinges and slides have all that.
    said = {each.name for each in loaded(tmp_path, CASES["what ball joints have"], axes="xyz").left_out}
    assert len(said) == 7
    said = {each.name for each in loaded(tmp_path, CASES["what a free joint has"]).left_out}
    assert said == set()
    with pytest.raises(ArgumentError, match="axes: got 'zxz', expected"):
        loaded(tmp_path, CASES["a ball joint"], axes="zxz")


def test_fixed_joints_stand_at_their_reference(tmp_path: Path) -> None:
    text = (
        f'<worldbody><body><joint name="a" ref="30"/>{INERTIAL}<body pos="1 0 0"><joint name="b" ref="20"/>{INERTIAL}'
        '<site name="tip" pos="1 0 0"/></body></body></worldbody><keyframe><key name="k" qpos="1 .1"/></keyframe>'
    )
    free, fixed = loaded(tmp_path, text), loaded(tmp_path, text, fixed=["b"])
    assert fixed.mechanism.variables == ("a",)
    q = free.mechanism.configuration({"a": 0.4, "b": np.radians(20)})
    np.testing.assert_allclose(
        fixed.mechanism.frame_pose(np.array([0.4]), "tip"), free.mechanism.frame_pose(q, "tip"), atol=1e-15
    )
    assert fixed.keyframes["k"].q == {"a": 1.0}
    with pytest.raises(ArgumentError, match="unknown joint 'c'"):
        loaded(tmp_path, text, fixed=["c"])


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    text = (
        '<option density="1.2"/><asset><mesh name="m" file="missing.stl"/></asset><worldbody><light/>'
        '<camera name="eye"/>'
        '<geom type="plane" size="1 1 1"/>{}</worldbody>'
    ).format(
        f'<body name="b"><joint name="j" type="ball" springdamper="1 1"/>{INERTIAL}<geom type="mesh" mesh="m"/></body>'
    )
    model = loaded(tmp_path, text)
    said = {each.name for each in model.left_out}
    for name in (
        "1 camera",
        "1 light",
        "mesh 'missing.stl'",
        "springdamper of the joint 'j'",
        "the medium (density, viscosity)",
    ):
        assert name in said, said
    with pytest.raises(ModelFileError, match="strict=True"):
        loaded(tmp_path, text, strict=True)


def test_massless_links_are_an_error_or_mended(tmp_path: Path) -> None:
    inner = '<body name="c"><joint name="k"/></body>'
    text = f'<worldbody><body name="b"><joint name="j"/>{INERTIAL}{inner}</body></worldbody>'
    with pytest.raises(ModelFileError, match=r"massless dynamic variable 'k'.*inertia='repair'"):
        loaded(tmp_path, text)
    model = loaded(tmp_path, text, inertia="repair")
    assert any(each.name == "masslessness of 'c'" for each in model.left_out)


def test_shapes_are_where_mujoco_has_its_geoms(tmp_path: Path) -> None:
    import mujoco

    text = f'<asset><mesh name="m" {CUBE}/></asset>' + body(
        '<geom type="capsule" size=".1" fromto="0 0 0 1 2 3"/><geom type="box" size=".1 .2 .3" euler="10 20 30"/>'
        '<geom type="cylinder" size=".2 .3" pos="1 0 0" rgba="1 0 0 1"/><geom group="3" size="1"/>',
        pos="0 0 1",
    )
    model = loaded(tmp_path, text)
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    d = mujoco.MjData(m)
    d.qpos[0] = 0.3
    mujoco.mj_forward(m, d)
    assert [shape.kind for shape in model.shapes] == ["capsule", "box", "cylinder"]
    assert model.shapes[2].color == (1.0, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(model.shapes[0].size, [0.1, 2 * m.geom_size[0][1]], atol=1e-15)
    for i, shape in enumerate(model.shapes):
        pose = model.mechanism.frame_pose(np.array([0.3]), shape.frame) @ shape.pose
        np.testing.assert_allclose(pose[:3, 3], d.geom_xpos[i], atol=1e-14)
        np.testing.assert_allclose(np.abs(pose[:3, 2]), np.abs(d.geom_xmat[i].reshape(3, 3)[:, 2]), atol=1e-14)
