"""Actuators, tendons, armatures and equality constraints of MJCF written by hand, against MuJoCo compiled here."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

import mujoco

import leastaction
from leastaction import ContinuousDynamics, MidpointSystem, MidpointVI, QuadraticCost, optimize
from leastaction.errors import ModelFileError
from leastaction.io.mechanisms import Model
from leastaction.io.mechanisms.poses import rotation_of
from leastaction.numerics.rotations import of_matrix
from oracles import mujoco_models

INERTIAL = '<inertial pos="0.1 0 .2" mass="2" diaginertia=".1 .2 .25"/>'
ARM = f"""
<compiler angle="radian"/>
<worldbody>
 <site name="base" pos=".1 .05 .2"/> <site name="hook" pos="-.3 .1 .4"/>
 <body name="upper" pos="0 .1 0">
  <joint name="a" axis="0 1 0" armature=".3" ref=".2" range="-1 1.5"/>
  <site name="u1" pos=".2 .05 .1"/> <site name="u2" pos=".25 -.05 .15"/> {INERTIAL}
  <body name="lower" pos="0 0 .5" euler="0 .3 .2">
   <joint name="b" axis="1 .2 0" pos="0 0 -.05" range="-.5 1"/> <site name="l1" pos=".1 .1 .2" euler=".3 .2 .1"/>
   <site name="l2" pos="-.1 .2 .3"/> {INERTIAL}
   <body name="slider" pos="0 .1 .1">
    <joint name="c" type="slide" axis="0 1 1" ref=".1" armature=".7" range="-.2 .4"/>
    <site name="s1" pos="0 .1 0"/> {INERTIAL}
   </body>
  </body>
 </body>
</worldbody>
<tendon>
 <fixed name="sum"><joint joint="a" coef="1.5"/><joint joint="b" coef="-.7"/><joint joint="c" coef="2"/></fixed>
 <spatial name="plain"><site site="hook"/><site site="u1"/><site site="l1"/></spatial>
 <spatial name="tackle">
  <site site="base"/><site site="u1"/><site site="u2"/><pulley divisor="2"/><site site="u2"/><site site="l1"/>
  <pulley divisor="4"/><site site="l2"/><site site="hook"/><site site="s1"/>
 </spatial>
</tendon>
"""
MUSCLE = 'lengthrange=".5 .9" range=".7 1.1" lmin=".4" lmax="1.7" vmax="1.4" fpmax="1.2" fvmax="1.3"'
FORCES = {
    "nothing but armatures": "",
    "motors": '<motor name="m" joint="a" gear="30"/><motor joint="c" gear="-2"/><general joint="b" gainprm="3"/>',
    "motors on tendons": '<motor tendon="sum" gear="4"/><motor tendon="plain" gear="-2"/><motor tendon="tackle"/>',
    "servos": (
        '<position name="p" joint="a" kp="20" kv="3" gear="2"/><velocity joint="b" kv="4"/>'
        '<position tendon="sum" kp="5" gear=".5"/><position tendon="tackle" kp="7" kv=".3"/>'
        '<velocity tendon="plain" kv="2" gear="3"/><position joint="c" kp="9" kv="2"/>'
    ),
    "servos by their damping ratio": (
        '<position name="p" joint="a" kp="20" dampratio=".7" gear="2"/><position joint="c" kp="8" dampratio="1"/>'
        '<position tendon="sum" kp="20" dampratio="1.2" gear="2"/><position tendon="tackle" kp="9" dampratio=".4"/>'
    ),
    "a damper": '<damper joint="b" kv="3" ctrlrange="0 1"/><damper tendon="tackle" kv="2" ctrlrange="0 2"/>',
    "general ones": (
        '<general joint="a" gear="3" gaintype="affine" gainprm="2 .5 -.3" biastype="affine" biasprm="1 -.7 .2"/>'
        '<general tendon="sum" gaintype="affine" gainprm="2 .5 -.3" biastype="affine" biasprm="1 -.7 .2"/>'
        '<general tendon="tackle" gear="-2" gaintype="affine" gainprm="0 .5 -.3" biastype="affine" biasprm="1 0 0"/>'
    ),
    "a state of activation": (
        '<intvelocity joint="a" kp="4" actrange="-1 1"/><general joint="b" dyntype="filter" dynprm=".1" gainprm="2"/>'
        '<cylinder joint="c" timeconst=".2" area=".3" bias="1 -2 -3"/>'
    ),
    "muscles": (
        f'<muscle tendon="plain" force="80" {MUSCLE}/>'
        f'<muscle tendon="tackle" scale="300" {MUSCLE.replace(".5 .9", ".3 .6").replace("1.3", "1")} gear="1.1"/>'
    ),
    "a propeller": '<motor site="l1" gear="0 0 1 0 0 -.02"/><general site="u1" gear="1 2 3 .1 .2 .3" gainprm="2"/>',
    "in the parent": '<motor jointinparent="a" gear="3"/>',
    "rotor and damping of an actuator": '<motor joint="a" gear="30" armature=".02" damping=".3"/>',
}
TENDONS = {
    "springs": 'stiffness="30" springlength=".4"',
    "slack springs": 'stiffness="30" springlength="0 .5"',
    "springs at rest where drawn": 'stiffness="30"',
    "dampers": 'damping="2"',
}


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "model.xml"
    file.write_text(f"<mujoco>{text}</mujoco>")
    return file


def compiled(file: Path, *on: str) -> tuple[Any, Any]:
    spec = mujoco.MjSpec.from_file(str(file))
    for flag in set(mujoco_models.OFF) - set(on):
        spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    m = spec.compile()
    return m, mujoco.MjData(m)


def assert_same_forces(file: Path, model: Model) -> None:
    """Compare what a random motion takes, with random inputs."""
    m, d = compiled(file, "ACTUATION")
    mechanism = mujoco_models.without_friction(model.mechanism)
    assert list(mechanism.variables) == [m.joint(i).name for i in range(m.njnt)]
    dynamics, rng = ContinuousDynamics(mechanism), np.random.default_rng(0)
    for _ in range(5):
        q, v, a = rng.uniform(-0.5, 0.5, (3, m.nv))
        u = rng.uniform(0.0, 1.0, m.nu)
        d.qpos[:], d.qvel[:], d.ctrl[:] = q, v, u
        for i in range(m.nu):
            if m.actuator_actnum[i]:
                d.act[m.actuator_actadr[i]] = u[i]
        mujoco.mj_forward(m, d)
        M = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, M)
        wanted = d.qfrc_bias - d.qfrc_passive - d.qfrc_actuator + M @ a
        got = dynamics.inverse_dynamics(q, v, a, u=u)
        np.testing.assert_allclose(mechanism.mass_matrix(q), M, rtol=0, atol=1e-10 * np.abs(M).max())
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("name", FORCES)
def test_actuators(tmp_path: Path, name: str) -> None:
    file = written(tmp_path, ARM + f"<actuator>{FORCES[name]}</actuator>")
    model = leastaction.load(file)
    for each in model.left_out:
        assert "activation dynamics" in each.name, each
    assert_same_forces(file, model)


@pytest.mark.parametrize("tendon", ["sum", "plain", "tackle"])
@pytest.mark.parametrize("name", TENDONS)
def test_tendons(tmp_path: Path, name: str, tendon: str) -> None:
    file = written(tmp_path, ARM.replace(f'name="{tendon}"', f'name="{tendon}" {TENDONS[name]}'))
    model = leastaction.load(file, strict=True)
    without = leastaction.load(written(tmp_path, ARM)).mechanism
    q, v = np.array([0.3, 0.4, -0.2]), np.array([1.0, -1.0, 0.5])
    forces = [ContinuousDynamics(m).inverse_dynamics(q, v, np.zeros(3)) for m in (model.mechanism, without)]
    assert np.abs(forces[0] - forces[1]).max() > 1e-3
    file = written(tmp_path, ARM.replace(f'name="{tendon}"', f'name="{tendon}" {TENDONS[name]}'))
    assert_same_forces(file, model)


def test_a_tendon_has_friction_inertia_and_limits(tmp_path: Path) -> None:
    more = 'name="sum" frictionloss=".4" armature=".3" limited="true" range="-.5 1"'
    file = written(tmp_path, ARM.replace('name="sum"', more).replace('name="plain"', 'name="plain" range="0 2"'))
    model = leastaction.load(file)
    assert model.mechanism.elements["friction.sum"].force == 0.4
    assert not model.left_out
    (plain,) = [each for each in model.limits if each.of == "length"]
    assert (str(plain), plain.min, plain.max) == ("PathBound('plain')", 0.0, 2.0)
    (bound,) = [each for each in model.limits if not isinstance(each.names, str)]
    assert dict(bound.names) == {"a": 1.5, "b": -0.7, "c": 2.0}
    assert_same_forces(file, model)


def test_limits_of_inputs(tmp_path: Path) -> None:
    text = (
        '<motor name="m" joint="a" ctrlrange="-2 3"/><motor name="n" joint="b" forcerange="-8 6" gear="5"/>'
        '<general name="g" joint="b" gainprm="2" forcerange="-8 6" ctrlrange="-1 9"/>'
        '<position name="p" joint="a" kp="3" forcerange="-1 1" inheritrange=".5"/>'
        f'<muscle name="q" tendon="plain" force="80" {MUSCLE}/>'
        '<intvelocity name="i" joint="a" kp="4" actrange="-1 1" ctrlrange="-9 9"/><motor name="free" joint="c"/>'
    )
    model = leastaction.load(written(tmp_path, ARM + f"<actuator>{text}</actuator>"))
    found = {each.names: (each.min, each.max) for each in model.limits if each.of == "input"}
    assert found == {
        "m": (-2.0, 3.0), "n": (-8.0, 6.0), "g": (-1.0, 3.0), "p": (-0.375, 0.875), "q": (0.0, 1.0), "i": (-1.0, 1.0)
    }  # fmt: skip
    assert "forcerange of the actuator 'p'" in [each.name for each in model.left_out]


def test_a_muscle_without_a_range_of_lengths_has_that_of_its_joints(tmp_path: Path) -> None:
    free = MUSCLE.replace('lengthrange=".5 .9"', "")
    file = written(tmp_path, ARM + f'<actuator><muscle name="m" tendon="plain" force="80" {free}/></actuator>')
    model = leastaction.load(file)
    (said,) = [each for each in model.left_out if "lengthrange" in each.name]
    assert "2000 samples" in said.why
    m, _ = compiled(file)
    low, high = m.actuator_lengthrange[0]
    ours = [float(part) for part in said.why.removesuffix(" m").split(": ")[1].split(" to ")]
    assert np.allclose(ours, [low, high], atol=0.05 * (high - low))


def test_the_range_of_a_muscle_beside_a_rotation(tmp_path: Path) -> None:
    muscle = '<actuator><muscle name="m" tendon="plain" force="80"/></actuator>'
    loose = f'<worldbody><body name="loose"><freejoint/>{INERTIAL}</body></worldbody>'
    texts = (ARM + muscle, loose + ARM + muscle)
    alone, beside = (leastaction.load(written(tmp_path, text)).left_out for text in texts)
    assert alone == beside
    assert "2000 samples" in alone[-1].why
    unlimited = ARM.replace('range="-1 1.5"', "").replace('range="-.5 1"', "")
    model = leastaction.load(written(tmp_path, unlimited + muscle))
    assert "it needs a lengthrange" in model.left_out[-1].why
    assert "m" not in model.mechanism.inputs


ROTATIONS = f"""
<worldbody>
 <body name="loose"><freejoint name="f"/>{INERTIAL}
  <body name="arm" pos="0 .1 0"><joint name="b" type="ball" pos=".1 0 .1"/>{INERTIAL}</body>
 </body>
</worldbody>
"""


def test_motors_of_ball_and_free_joints(tmp_path: Path) -> None:
    actuators = '<motor joint="b" gear="2 -3 .5"/><motor joint="f" gear="1 0 2 .3 0 -4"/>'
    file = written(tmp_path, ROTATIONS + f"<actuator>{actuators}</actuator>")
    model, (m, d) = leastaction.load(file, strict=True), compiled(file, "ACTUATION")
    rng = np.random.default_rng(0)
    d.qpos[:], d.qvel[:], d.ctrl[:] = rng.normal(size=m.nq), rng.normal(size=m.nv), [0.7, -1.3]
    mujoco.mj_normalizeQuat(m, d.qpos)
    mujoco.mj_forward(m, d)
    got = ContinuousDynamics(model.mechanism).accelerations(d.qpos, d.qvel, d.ctrl).a
    np.testing.assert_allclose(got, d.qacc, rtol=0, atol=1e-9 * np.abs(d.qacc).max())


@pytest.mark.parametrize(
    ("actuator", "why"),
    [
        ('<position name="x" joint="b" kp="3"/>', "a servo needs a length"),
        ('<motor name="x" jointinparent="b" gear="1 0 0"/>', "those before the ball joint 'b'"),
        ('<motor name="x" joint="f" gear="0"/>', "its gear is zero"),
    ],
)
def test_what_does_not_turn_a_ball_is_said(tmp_path: Path, actuator: str, why: str) -> None:
    model = leastaction.load(written(tmp_path, ROTATIONS + f"<actuator>{actuator}</actuator>"))
    (said,) = model.left_out
    assert why in said.why


@pytest.mark.parametrize(
    ("actuator", "why"),
    [
        ('<adhesion name="x" body="lower" gain="1" ctrlrange="0 1"/>', "adhesion needs contact"),
        ('<motor name="x" cranksite="u1" slidersite="base" cranklength=".3"/>', "slider-crank"),
        ('<motor name="x" site="l1" refsite="u1" gear="1 0 0 0 0 0"/>', "between two sites"),
        ('<velocity name="x" site="l1" kv="1" gear="1 0 0 0 0 0"/>', "feedback of the velocity of a site"),
        ('<motor name="x" joint="a" gear="0"/>', "its gear is zero"),
        ('<muscle name="x" joint="a" lengthrange="0 1"/>', "a muscle pulls along a spatial tendon"),
    ],
)
def test_what_is_left_out_is_said(tmp_path: Path, actuator: str, why: str) -> None:
    file = written(tmp_path, ARM + f"<actuator>{actuator}</actuator>")
    model = leastaction.load(file)
    (said,) = [each for each in model.left_out if each.name == "actuator 'x'"]
    assert why in said.why
    assert "x" not in model.mechanism.inputs
    with pytest.raises(ModelFileError, match="left out"):
        leastaction.load(file, strict=True)


# Equality constraints

EQUALITIES = {
    "connected": '<connect body1="slider" body2="upper" anchor=".1 .2 .3"/>',
    "connected to the world": '<connect body1="lower" anchor=".1 .2 .3"/>',
    "connected sites": '<connect site1="s1" site2="u2"/>',
    "a joint by another": '<joint joint1="b" joint2="c" polycoef=".1 .5 0 0 0"/>',
    "a joint by a polynomial": '<joint joint1="a" joint2="c" polycoef=".1 .5 -.3 .2 .7"/>',
    "a joint held": '<joint joint1="a" polycoef=".1 0 0 0 0"/>',
    "a tendon by another": '<tendon tendon1="tackle" tendon2="sum" polycoef=".1 .5 -.3 .2 .7"/>',
    "tendons of paths": '<tendon tendon1="plain" tendon2="tackle" polycoef="0 .5 0 0 0"/>',
    "a tendon held": '<tendon tendon1="plain" polycoef="-.05 0 0 0 0"/>',
}


@pytest.mark.parametrize("name", EQUALITIES)
def test_equalities(tmp_path: Path, name: str) -> None:
    file = written(tmp_path, ARM + f"<equality>{EQUALITIES[name]}</equality>")
    model = leastaction.load(file, strict=True)
    m, d = compiled(file, "EQUALITY")
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(-0.5, 0.5, m.nv)
        d.qpos[:] = q
        mujoco.mj_forward(m, d)
        J = np.zeros((d.nefc, m.nv))
        J[:] = d.efc_J.reshape(d.nefc, m.nv)
        residuals, jacobian = (
            list(model.mechanism.constraint_residuals(q).values()),
            model.mechanism.constraint_jacobian(q),
        )
        np.testing.assert_allclose(residuals, d.efc_pos, rtol=0, atol=1e-10)
        np.testing.assert_allclose(jacobian, J, rtol=0, atol=1e-10)


@pytest.mark.parametrize("more", ["", 'relpose=".1 .2 .3 .9 .1 .2 .3" anchor=".1 .1 0"', 'anchor=".1 .2 .3"'])
@pytest.mark.parametrize("ends", ['body1="slider" body2="upper"', 'body1="lower"', 'site1="s1" site2="u2"'])
def test_a_weld(tmp_path: Path, ends: str, more: str) -> None:
    """Where MuJoCo's equations hold ours do, and there are six."""
    if "site" in ends and more:
        pytest.skip("of sites a weld has no pose")
    free = (
        f'<worldbody><body name="loose" pos="1 2 3" euler="10 20 30"><freejoint name="f"/>{INERTIAL}</body></worldbody>'
    )
    body = ends.replace('"slider"', '"loose"').replace('"lower"', '"loose"').replace('site1="s1"', 'site1="at"')
    free = free.replace("</body>", '<site name="at" pos=".1 .2 0" euler="5 6 7"/></body>')
    file = written(tmp_path, ARM + free + f"<equality><weld {body} {more}/></equality>")
    mechanism = leastaction.load(file, strict=True).mechanism
    m, d = compiled(file, "EQUALITY")
    mujoco.mj_forward(m, d)
    free, other = ("at", "u2") if "site" in ends else ("loose", "upper" if "slider" in ends else "world")
    kind = "site" if "site" in ends else "xbody"
    first, second, loose = (_pose(d, *of) for of in ((kind, free), (kind, other), ("xbody", "loose")))
    relative = np.eye(4) if "site" in ends else np.linalg.inv(first) @ second
    if "relpose" in more:
        relative = np.eye(4)
        R = rotation_of([0.9, 0.1, 0.2, 0.3])
        relative[:3, :3], relative[:3, 3] = R, np.array([0.1, 0.2, 0.3]) - R @ [0.1, 0.1, 0.0]
    wanted = second @ np.linalg.inv(relative) @ np.linalg.inv(first) @ loose
    d.qpos[3:] = np.concatenate([wanted[:3, 3], of_matrix(wanted[:3, :3])])
    mujoco.mj_forward(m, d)
    assert d.nefc == 6
    assert np.abs(d.efc_pos).max() < 1e-12
    q = d.qpos.copy()
    assert max(map(abs, mechanism.constraint_residuals(q).values())) < 1e-12
    assert mechanism.constraint_rank(q) == 6


def _pose(d: Any, kind: str, name: str) -> np.ndarray:
    pose = np.eye(4)
    if name != "world":
        part = d.site(name) if kind == "site" else d.body(name)
        pose[:3, :3], pose[:3, 3] = part.xmat.reshape(3, 3), part.xpos
    return pose


def test_what_does_not_hold_is_left_out(tmp_path: Path) -> None:
    text = (
        '<joint name="x" joint1="a" joint2="b" active="false"/><connect name="y" body1="upper" anchor="0 0 0"/>'
        '<joint name="z" joint1="a" joint2="b"/>'
    )
    model = leastaction.load(written(tmp_path, ARM + f"<equality>{text}</equality>"), fixed=["a"])
    said = {each.name: each.why for each in model.left_out}
    assert said == {
        "equality 'x'": "it is not active",
        "equality 'y'": "nothing moves its ends relative to each other",
    }
    assert list(model.mechanism.elements["z"].factors) == ["b"]


# A whole mechanism

MODELS = Path(os.environ.get("LEASTACTION_MODELS") or Path(__file__).resolve().parents[4] / "shared/data/models")
FINGER = MODELS / "myofinger/myofinger_v0.xml"


@pytest.mark.skipif(not FINGER.exists(), reason="the tendon finger is not beside the checkout")
@pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning")  # of the start, which is left at once
def test_the_tendon_finger_bends_by_its_muscles() -> None:
    model = leastaction.load(FINGER)
    m = model.mechanism
    assert set(m.inputs) == {"extn", "adabR", "adabL", "mflx", "dflx"}
    assert all((b.min, b.max) == (0.0, 1.0) for b in model.limits if b.of == "input")
    assert "wrapping of the tendon 'dflx' around pg1, mg2, dg3" in [each.name for each in model.left_out]
    t, bent = np.linspace(0.0, 0.5, 26), np.array([0.0, 0.6, 0.8, 0.7])
    vi = MidpointVI(m)
    start = vi.simulate(vi.start([0.0, 0.3, 0.3, 0.3]), t, inputs=np.full((25, 5), 0.02))
    cost = QuadraticCost(
        np.tile([*bent, 0, 0, 0, 0], (26, 1)), np.zeros((25, 5)), Q=[10.0] * 4 + [0.0] * 4, R=[0.1] * 5
    )
    result = optimize(MidpointSystem(vi, t), cost, initial=(start.x, start.u), limits=list(model.limits))
    assert result.u.min() >= 0.0
    assert result.u.max() <= 1.0
    np.testing.assert_allclose(result.x[-1, :4], bent, atol=0.05)
