"""Ball and free joints whose rotation is a quaternion: names, units, files, and errors of what is not there."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import leastaction as la
from leastaction.control import close_loop
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.expressions import variable
from leastaction.mechanics import (
    Armature,
    BodyWrench,
    CoulombFriction,
    Damping,
    ExpressionPotential,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    NonlinearDamping,
    Trajectory,
    ball,
    free,
    rz,
    simulate,
    tx,
    tz,
)
from leastaction.systems import MechanismSystem


def floater(*elements: Any) -> Mechanism:
    base = free("base", axes="quaternion", mass=2.0, inertia=(0.1, 0.2, 0.15))
    arm = [tx(0.2), [ball("arm", axes="quaternion", name="hand", mass=0.3, com=(0.1, 0.0, 0.05), inertia=(1e-3,) * 3)]]
    return Mechanism([base, [*arm, rz("wheel", mass=0.1, inertia=(1e-3,) * 3)]], [Gravity(), *elements])


def moved(m: Mechanism) -> Trajectory:
    vi = MidpointVI(m)
    speed = np.linspace(-1.0, 2.0, m.nv)
    return vi.simulate(vi.start(m.configuration({"base.z": 1.0, "wheel": 0.3}), speed), np.linspace(0.0, 0.5, 26))


def test_names_sizes_and_units() -> None:
    m = floater()
    turns = tuple(f"base.w{letter}" for letter in "xyz"), tuple(f"arm.w{letter}" for letter in "xyz")
    places = tuple(f"base.{letter}" for letter in "xyz")
    assert m.variables == (*places, *turns[0], *turns[1], "wheel")
    quaternions = [tuple(f"{name}.q{letter}" for letter in "wxyz") for name in ("base", "arm")]
    assert m.coordinates == (*places, *quaternions[0], *quaternions[1], "wheel")
    assert (m.nq, m.nv, m.nd, m.nx, m.ndx) == (12, 10, 10, 22, 20)
    q = m.configuration({"wheel": 1.0})
    assert m.named(q) == dict(zip(m.coordinates, [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1.0], strict=True))
    run = moved(m)
    assert run["arm.qw"].shape == (26,)
    assert run.units["arm.qw"] == "1"
    assert run.units["arm.wx"] == "rad"
    assert run.state_units[3:7] == ("1",) * 4
    assert run.velocity("arm.wx").shape == (25,)
    assert "free(base: x y z qw qx qy qz)" in str(m)


def test_is_the_same_after_files_and_processes(tmp_path: Path) -> None:
    m = floater(BodyWrench("hand", torque=("a", "b", 0.1)))
    path = tmp_path / "floater.yaml"
    m.save(path)
    for other in (Mechanism.load(path), pickle.loads(pickle.dumps(m)), m.with_parameters({})):
        assert other == m
        assert other.coordinates == m.coordinates
    heavier = m.with_parameters({"base.mass": 3.0})
    assert heavier.mass == pytest.approx(3.4)
    grown = m.with_frames("hand", [tx(0.1, name="tip")])
    assert grown.coordinates == m.coordinates
    run = moved(m)
    run.save(tmp_path / "run.npz")
    back = la.open(tmp_path / "run.npz")
    assert np.array_equal(back.trajectory.q if hasattr(back, "trajectory") else back.q, run.q)


def test_motions_in_continuous_time_are_kept_and_drawn(tmp_path: Path) -> None:
    m = floater()
    run = simulate(m, m.configuration(), np.linspace(-1.0, 2.0, m.nv), np.linspace(0.0, 0.5, 11))
    assert (run.q.shape, run.v.shape, run.a.shape) == ((11, 12), (11, 10), (11, 10))
    assert len(run.state_units) == m.nx
    run.save(tmp_path / "run.npz")
    back = la.open(tmp_path / "run.npz")
    for other in (back, pickle.loads(pickle.dumps(run))):
        assert np.array_equal(other.x, run.x)
    assert np.array_equal(pickle.loads(pickle.dumps(run))(0.123), run(0.123))
    la.show(run).save(tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 1000
    assert run.reactions()["hand"].shape == (11, 6)
    system = MechanismSystem(m)
    assert system.state_names == (*m.coordinates, *(f"v_{name}" for name in m.variables))


def test_is_drawn(tmp_path: Path) -> None:
    la.show(moved(floater())).save(tmp_path / "run.html")
    la.show(floater()).save(tmp_path / "still.html")
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("run.html", "still.html"))


def test_mass_matrix_is_that_of_angles_at_zero() -> None:
    """Where all angles are zero their rates are the angular velocity."""
    one = floater()
    other = Mechanism(
        [
            free("base", axes="xyz", mass=2.0, inertia=(0.1, 0.2, 0.15)),
            [
                *[tx(0.2), [ball("arm", axes="xyz", name="hand", mass=0.3, com=(0.1, 0.0, 0.05), inertia=(1e-3,) * 3)]],
                rz("wheel", mass=0.1, inertia=(1e-3,) * 3),
            ],
        ],
        [Gravity()],
    )
    found = one.mass_matrix(one.configuration()), other.mass_matrix(other.configuration())
    assert np.abs(found[0] - found[1]).max() < 1e-15


REFUSED: dict[str, Callable[[], Any]] = {
    "own coordinates": lambda: ball(["a", "b", "c"], axes="quaternion"),
    "prescribed in part": lambda: ball("a", axes="quaternion", kinematic=["a.wx"]),
    "universal": lambda: la.universal("a", axes="quaternion"),
    "a rotor": lambda: floater(Armature("arm.wx", 1.0)),
    "a formula": lambda: floater(ExpressionPotential(variable("arm.wx") * variable("wheel"))),
    "apart": lambda: Mechanism(
        [ball("a", axes="quaternion", mass=1.0, inertia=(1.0, 1.0, 1.0)), tz("z", mass=1.0)],
        dynamic=["a.wx", "z", "a.wy", "a.wz"],
    ),
}


def test_elements_on_turns_of_joints() -> None:
    """Springs pull along the rotation vector, dampers and motors act along the axes behind the joint."""
    axes = [f"arm.w{letter}" for letter in "xyz"]
    m = floater(
        *[JointSpring(name, 0.7) for name in axes],
        *[JointForce(name, f"u{name[-1]}", name=f"motor{name[-1]}") for name in axes],
        Damping(0.3),
        NonlinearDamping("arm.wz", (0.0, 0.1)),
        CoulombFriction({"arm.wy": 2.0, "wheel": 1.0}, 0.2, 0.5),
    )
    assert m.parameters["damping.arm.wy"] == 0.3
    rng = np.random.default_rng(4)
    phi = np.array([1.2, -2.0, 0.8])
    q, v, u = m.configuration(), rng.standard_normal(m.nv), rng.standard_normal(3)
    place, turn = m.coordinates.index("arm.qw"), m.variables.index("arm.wx")
    angle = float(np.linalg.norm(phi))
    for sign in (1.0, -1.0):  # the same rotation
        q[place : place + 4] = sign * np.r_[np.cos(angle / 2.0), np.sin(angle / 2.0) * phi / angle]
        pull = m.core.gradient(q, np.zeros(m.nv))[0] - floater().core.gradient(q, np.zeros(m.nv))[0]
        wanted = np.zeros(m.nv)
        wanted[turn : turn + 3] = -0.7 * phi
        assert np.abs(pull - wanted).max() < 1e-14
        assert m.core.potential_energy(q) - floater().core.potential_energy(q) == pytest.approx(0.35 * angle**2)
    force = -0.3 * v
    force[turn : turn + 3] += u
    force[turn + 2] -= 0.1 * v[turn + 2] ** 3
    dry = 0.2 * np.tanh((2.0 * v[turn + 1] + v[-1]) / 0.5)
    force[turn + 1] -= 2.0 * dry
    force[-1] -= dry
    assert np.abs(m.core.force(q, v, u) - force).max() < 1e-14


def test_motors_on_the_turns_of_a_joint_are_a_wrench_and_what_it_reacts_on() -> None:
    """On a joint that stands on the world a torque is all there is."""
    runs = []
    for torque in (
        [BodyWrench("top", torque=("a", "b", "c"))],
        [JointForce(f"top.w{letter}", name) for letter, name in zip("xyz", "abc", strict=True)],
    ):
        top = ball("top", axes="quaternion", mass=1.1, com=(0.0, 0.1, 0.3), inertia=(0.1, 0.2, 0.15))
        vi = MidpointVI(Mechanism([top], [Gravity(), *torque]))
        runs.append(vi.simulate(vi.start([1, 0, 0, 0], [1, 2, 3]), np.linspace(0, 1, 51), inputs=[0.3, -0.2, 0.5]))
    assert np.abs(runs[0].x - runs[1].x).max() < 1e-13


@pytest.mark.parametrize("what", list(REFUSED))
def test_what_has_no_angle_is_refused(what: str) -> None:
    with pytest.raises(DescriptionError, match=r"quaternion|turns of|letters of 'xyz'"):
        REFUSED[what]()


def test_a_joint_is_turned_and_held_by_its_name() -> None:
    solid = {"mass": 1.0, "inertia": (0.1, 0.2, 0.3)}
    m = Mechanism([free("hull", **solid), [ball("arm", **solid)]], [])
    turned = m.configuration({"hull": [0.8, 0.6, 0.0, 0.0], "hull.z": 2.0})
    np.testing.assert_array_equal(turned, [0.0, 0.0, 2.0, 0.8, 0.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(MidpointVI(m).start({"hull": [0.8, 0.6, 0.0, 0.0], "hull.z": 2.0}).q, turned)
    for wrong, match in (
        ([0.6, 0.8], r"values: the value of 'hull': got shape \(2,\), expected \(4,\), that is a unit quaternion"),
        ([1.0, 1.0, 0.0, 0.0], "are a unit quaternion, scalar first, whose length is 1; got the length 1.41421"),
    ):
        with pytest.raises(ArgumentError, match=match):
            m.configuration({"hull": wrong})
    tree = [ball("upper", **solid), [la.tx(1.0), [ball("lower", **solid), [la.tx(1.0, name="end")]]]]
    chain = Mechanism(tree, [la.PointToPoint("end", "world", "z")])
    guess = chain.configuration({"upper": [0.96, 0.0, 0.28, 0.0]})
    held = la.project_configuration(chain, guess, hold=["upper"]).q
    np.testing.assert_array_equal(held[:4], guess[:4])
    assert np.abs(held[4:] - guess[4:]).max() > 0.1


def test_between_its_instants_an_optimised_motion_has_rotations() -> None:
    """On a mesh that is still coarse, polynomials between its points are off the length of quaternions."""
    m = Mechanism([ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4))], [JointForce(f"hull.w{a}", a) for a in "xyz"])
    system, still = la.MechanismSystem(m), np.array([1.0, 0, 0, 0, 0, 0, 0])
    over = np.array([0.1, np.sqrt(0.99), 0, 0, 0, 0, 0])
    cost = la.ContinuousQuadraticCost(over, np.zeros(3), Q=[1.0] * 6, R=[1e-3] * 3, space=system)
    found = la.optimize(system, cost, initial=(still, np.zeros(3)), horizon=(0.0, 2.0), max_iterations=3)
    t = np.linspace(0.0, 2.0, 401)
    lengths = np.linalg.norm([found.dense.x(at)[:4] for at in t], axis=1)
    assert np.abs(lengths - 1.0).max() > 1e-6
    np.testing.assert_allclose(np.linalg.norm(found.trajectory(t)[:, :4], axis=1), 1.0, atol=1e-14)
    assert len(la.show(found).scenes[0].t) >= len(found.t)


def test_a_quaternion_has_length_one() -> None:
    m = floater()
    q = m.configuration()
    q[3] = 1.1
    for asked in (MidpointVI(m).start, m.positions):
        with pytest.raises(ArgumentError, match=r"base\.qw.*length 1\.1"):
            asked(q)
    with pytest.raises(ArgumentError, match=r"unit quaternion"):
        m.configuration({"base.qx": 0.5})
    # Rounding of a file is taken out.
    q[3] = 1.0 + 1e-8
    assert MidpointVI(m).start(q).q[3] == 1.0


def test_numbers_may_be_given_by_name_wherever_one_row_is_taken() -> None:
    base = la.free("base", mass=1.0, inertia=(1.0, 2.0, 3.0))
    mechanism = la.Mechanism([base, [la.rx("hip", mass=1.0, com=(0, 0, -1))]], [la.JointForce("hip", input="torque")])
    vi = la.MidpointVI(mechanism)
    q, v = mechanism.configuration({"hip": 0.3}), mechanism.velocity({"base.wx": 2.0})
    start = vi.start({"hip": 0.3}, {"base.wx": 2.0})
    np.testing.assert_array_equal(start.x, vi.start(q, v).x)
    momentum = dict(zip(mechanism.dynamic, start.p, strict=True))
    np.testing.assert_array_equal(vi.start({"hip": 0.3}, p=momentum).x, start.x)
    np.testing.assert_array_equal(mechanism.positions({"hip": 0.3}), mechanism.positions(q))
    assert mechanism.energy({"hip": 0.3}, {"base.wx": 2.0}) == mechanism.energy(q, v)
    t = np.linspace(0.0, 0.1, 11)
    by_name, by_place = (vi.simulate(start, t, inputs=given) for given in ({"torque": 1.0}, [1.0]))
    np.testing.assert_array_equal(by_name.q, by_place.q)
    flow = la.simulate(mechanism, {"hip": 0.3}, {"base.wx": 2.0}, t, inputs={"torque": 1.0})
    np.testing.assert_array_equal(flow.q, la.simulate(mechanism, q, v, t, inputs=[1.0]).q)
    system = la.MidpointSystem(vi, t)
    for each, x in ((system, vi.start(q).x), (la.MechanismSystem(mechanism), np.concatenate([q, 0.0 * v]))):
        np.testing.assert_array_equal(each.state_given({"hip": 0.3}), x)
    law = lambda t, x: np.zeros(1)  # noqa: E731
    np.testing.assert_array_equal(close_loop(vi, law, {"hip": 0.3}, t).x[0], vi.start(q).x)
    with pytest.raises(la.LeastActionError, match=r"x: got a quaternion of length 0"):
        close_loop(vi, law, np.zeros(system.nx), t)
    with pytest.raises(la.LeastActionError, match=r"v: unknown name 'base.w'; did you mean 'base.w"):
        vi.start(q, {"base.w": 1.0})
    with pytest.raises(la.LeastActionError, match=r"q: the value of 'hip': got None"):
        vi.start({"hip": None})  # type: ignore[dict-item]


def test_a_velocity_of_a_joint_goes_by_its_name() -> None:
    m = Mechanism([free("hull", mass=1.0, inertia=(1.0, 2.0, 2.5))], [])
    vi, q = MidpointVI(m), m.configuration()
    apart = {"hull.x": 2.0, "hull.wx": 1.0, "hull.wy": 2.0, "hull.wz": 3.0}
    together = {"hull.x": 2.0, "hull": [1.0, 2.0, 3.0]}
    assert (m.velocity(together) == m.velocity(apart)).all()
    assert (vi.start(q, together).p == vi.start(q, apart).p).all()
    assert m.energy(q, together) == m.energy(q, apart)
    with pytest.raises(ArgumentError, match=r"'hull': got shape \(2,\), expected \(3,\), that is an angular velocity"):
        m.velocity({"hull": [1.0, 2.0]})


def test_frames_within_a_rotation_are_told_to_nobody() -> None:
    m = Mechanism([ball("hip", name="leg", mass=1.0, inertia=(1.0, 2.0, 2.5))], [])
    assert m.frames == ("world", "leg")
    assert m.positions(m.configuration()).shape == (2, 3)
    with pytest.raises(ArgumentError, match=r"the frames are 'world', 'leg'$"):
        m.frame_pose(m.configuration(), "quite another")
    with pytest.raises(DescriptionError, match=r"the frames are 'world', 'leg'$"):
        m.with_elements([LinearSpring("quite another", "leg", 1.0)])
    with pytest.raises(DescriptionError, match=r"massless joint 'hip': by 'hip.wx' it turns what hangs on it"):
        Mechanism([ball("hip", name="leg", mass=1.0)], [])
    with pytest.raises(DescriptionError, match=r"massless joint 'hip': .* where nothing has a mass"):
        Mechanism([ball("hip", name="leg")], [])
