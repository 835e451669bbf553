"""Velocities, Jacobians and momenta of frames against automatic differentiation of their poses."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

pytest.importorskip("jax")

import jax
import jax.numpy as jnp

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Body,
    Distance,
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    free,
    pose,
    prismatic,
    revolute,
    rx,
    ry,
    rz,
    screw,
    twist,
    tx,
    ty,
    tz,
    universal,
    var,
)
from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints

AXIS, POINT = (0.3, -1.2, 0.7), (0.2, 0.5, -0.4)
TURN = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
HEAVY = {"mass": 0.7, "com": (0.1, -0.2, 0.3), "inertia": (0.3, 0.4, 0.5, 0.01, -0.02, 0.03)}


def every_joint():
    """Every kind of joint, in two branches, with constant poses between."""
    return [
        revolute("a", axis=AXIS, point=POINT, **HEAVY), [
            pose(translation=(0.1, -0.2, 0.3), rotation=TURN), [
                screw("b", axis="-y", point=POINT, pitch=0.3, **HEAVY), [
                    tz(0.4, name="ledge"), [
                        twist("c", linear=(0.1, 0.2, -0.3), angular=(0.4, -0.5, 1.6), name="tip", **HEAVY)],
                ],
                prismatic("d", axis=AXIS, mass=1.0), [ry("k", kinematic=True, name="side", **HEAVY)],
            ],
        ],
        free("body", axes="zxz", **HEAVY), [universal("u", name="end", **HEAVY)],
        tx(0.5, name="post", bodies=[Body(2.0, com=(0, 0, 1))]),
    ]  # fmt: skip


def coupled():
    """Variables that move many frames, above one another and side by side, of both kinds."""
    return [
        rz("a", **HEAVY), [
            tx(1.0), [
                rz(-2.0 * var("a") + 0.4, name="link", **HEAVY), [
                    revolute({"a": 0.5, "b": 1.5, "k": -1.0}, axis=AXIS, kinematic=["k"], **HEAVY), [
                        screw(var("k") + 0.2, axis="x", pitch=0.1, kinematic=True, name="tip", **HEAVY)]],
            ],
        ],
        tx(0.3 * var("b"), name="slide", **HEAVY), [ball(["c", 2 * var("c"), "b"], name="head", **HEAVY)],
    ]  # fmt: skip


DESCRIPTIONS = {"every joint": every_joint, "couplings": coupled}


@pytest.fixture(scope="module", params=DESCRIPTIONS)
def mechanism(request):
    return Mechanism(DESCRIPTIONS[request.param]())


def exponential(hat, rate, s):
    """exp(hat s): hat^4 = -rate^2 hat^2 for every twist, so the series ends after hat^3."""
    if rate == 0.0:
        return jnp.eye(4) + s * hat
    return (
        jnp.eye(4)
        + s * hat
        + (1.0 - jnp.cos(rate * s)) / rate**2 * hat @ hat
        + (rate * s - jnp.sin(rate * s)) / rate**3 * hat @ hat @ hat
    )


def joint_poses(mechanism, q):
    column = {name: i for i, name in enumerate(mechanism.variables)}
    poses = []
    for joint in mechanism.tree.joints:
        x, y, z, a, b, c = joint.twist
        hat = np.array([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]])
        s = joint.coordinate.offset + sum(f * q[column[n]] for n, f in joint.coordinate.terms)
        carrier = jnp.eye(4) if joint.parent < 0 else poses[joint.parent]
        poses.append(carrier @ joint.pose @ exponential(hat, np.linalg.norm([a, b, c]), s))
    return poses


def frame_pose(mechanism, name, q):
    frame = mechanism.tree.frames[mechanism.frames.index(name)]
    poses = joint_poses(mechanism, q)
    return (jnp.eye(4) if frame.joint < 0 else poses[frame.joint]) @ frame.pose


def velocity(mechanism, name, point, axes, q, v):
    """Velocity of a point of a frame and its angular velocity, from the derivative of the pose along v."""
    G, G_dot = jax.jvp(partial(frame_pose, mechanism, name), (q,), (v,))
    W = G_dot[:3, :3] @ G[:3, :3].T
    linear, angular = G_dot[:3, :3] @ point + G_dot[:3, 3], jnp.array([W[2, 1], W[0, 2], W[1, 0]])
    if axes == "frame":
        linear, angular = G[:3, :3].T @ linear, G[:3, :3].T @ angular
    return jnp.concatenate([linear, angular])


@pytest.mark.parametrize("axes", ["world", "frame"])
@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0), (0.3, -0.4, 0.2)])
def test_frame_velocities_and_jacobians_against_automatic_differentiation(mechanism, axes, point):
    rng = np.random.default_rng(7)
    for name in ("tip", "end") if "end" in mechanism.frames else ("tip", "head"):
        q, v = rng.uniform(-1.5, 1.5, (2, mechanism.nq))
        oracle = partial(velocity, mechanism, name, jnp.array(point), axes)
        options = {"point": point, "axes": axes}
        np.testing.assert_allclose(mechanism.frame_velocity(q, v, name, **options), oracle(q, v), atol=1e-12)
        J = mechanism.frame_jacobian(q, name, **options)
        assert J.shape == (6, mechanism.nq)
        np.testing.assert_allclose(J, jax.jacfwd(oracle, argnums=1)(q, v), atol=1e-12)
        dJ = mechanism.frame_jacobian_derivative(q, name, **options)
        expected = jax.jacfwd(jax.jacfwd(oracle, argnums=1), argnums=0)(q, v)
        np.testing.assert_allclose(dJ, expected, atol=1e-12)
        assert np.abs(dJ).max() > 0.1


def test_points_move_and_bend_as_their_frames_say(mechanism):
    """Places, first and contracted second derivatives, against those of frames, which are held to JAX above."""
    rng = np.random.default_rng(13)
    q, force, weight = rng.uniform(-1.5, 1.5, (3, mechanism.nq)), rng.normal(size=(3, 3, 3)), rng.normal(size=(3, 3))
    names = "tip", "end" if "end" in mechanism.frames else "head", "world"
    offsets = np.array([[0.3, -0.4, 0.2], [1.0, 0.5, -0.7], [-0.2, 0.1, 0.6]])
    points = MovedPoints.of(mechanism, names, offsets)
    bent = np.zeros((3, mechanism.nq, mechanism.nq))
    for i, (name, offset) in enumerate(zip(names, offsets, strict=True)):
        pose = mechanism.frame_pose(q, name)
        np.testing.assert_allclose(points.places(q)[:, i], pose[:, :3, :3] @ offset + pose[:, :3, 3], atol=1e-13)
        J = mechanism.frame_jacobian(q, name, point=offset)[:, :3]
        np.testing.assert_allclose(points.jacobian(q)[:, i], J, atol=1e-13)
        slopes = points.slopes(q, [i], force[:, i : i + 1])
        np.testing.assert_allclose(slopes[:, 0], np.einsum("na,nai->ni", force[:, i], J), atol=1e-13)
        dJ = mechanism.frame_jacobian_derivative(q, name, point=offset)
        bent += np.einsum("na,naij->nij", force[:, i], dJ[:, :3])
        bent += np.einsum("n,nai,naj->nij", weight[:, i], J, J)
    np.testing.assert_allclose(points.bent(q, force, weight), bent, atol=1e-12)


def test_points_move_apart_as_each_of_them_moves(mechanism):
    rng = np.random.default_rng(14)
    q = rng.uniform(-1.5, 1.5, (3, mechanism.nq))
    end = "end" if "end" in mechanism.frames else "head"
    # Both on one limb, one in the world, and one on two limbs.
    points = MovedPoints.of(mechanism, ["tip", end, "tip", "tip", "world", end], rng.normal(size=(6, 3)))
    along, stiff, weight = rng.normal(size=(3, 3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    J = points.jacobian(q)
    D = J[:, :3] - J[:, 3:]
    np.testing.assert_allclose(points.apart(q), points.places(q)[:, :3] - points.places(q)[:, 3:], atol=1e-14)
    slopes = np.einsum("npa,npai->npi", along, D)
    np.testing.assert_allclose(points.apart_slopes(q, along), slopes, atol=1e-12)
    bent = np.einsum("np,npi,npj->nij", stiff, slopes, slopes) + np.einsum("np,npai,npaj->nij", weight, D, D)
    np.testing.assert_allclose(points.apart_bent(q, along, stiff, weight), bent, atol=1e-12)
    assert np.abs(bent).max() > 0.1


def along(function, directions):
    """The derivative of a function along directions, by automatic differentiation."""
    for direction in directions:
        function = partial(lambda inner, d, q: jax.jvp(inner, (q,), (d,))[1], function, jnp.asarray(direction))
    return function


@pytest.mark.parametrize("inverse", [False, True])
def test_derivatives_of_poses_to_the_fourth_order_against_automatic_differentiation(mechanism, inverse):
    rng = np.random.default_rng(9)
    q, *directions = rng.uniform(-1.5, 1.5, (4, mechanism.nq))

    def pose_of(at):
        G = frame_pose(mechanism, "tip", at)
        return jnp.linalg.inv(G) if inverse else G

    np.testing.assert_allclose(mechanism.frame_pose(q, "tip", inverse=inverse), pose_of(q), atol=1e-13)
    for order in (1, 4):
        chosen = directions[: order - 1]
        wanted = jax.jacfwd(along(pose_of, chosen))(q)
        options = {"order": order, "inverse": inverse}
        found = mechanism.frame_pose_derivative(q, "tip", along=chosen, **options)
        np.testing.assert_allclose(found, wanted, atol=1e-12 * max(1.0, np.abs(wanted).max()))
        assert np.abs(found).max() > 0.1
        full = mechanism.frame_pose_derivative(q, "tip", **options)
        assert full.shape == (4, 4, *[mechanism.nq] * order)
        for axis in range(2, order + 1):
            np.testing.assert_allclose(full, full.swapaxes(axis, axis + 1), atol=1e-12)
        for direction in chosen:
            full = full @ direction
        np.testing.assert_allclose(full, found, atol=1e-12 * max(1.0, np.abs(wanted).max()))


@pytest.mark.parametrize("axes", ["world", "frame"])
def test_derivatives_of_velocities_to_the_fourth_order_against_automatic_differentiation(mechanism, axes):
    """By the configuration up to three times, and by the velocity too."""
    rng = np.random.default_rng(10)
    q, v, *directions = rng.uniform(-1.5, 1.5, (4, mechanism.nq))
    point = (0.3, -0.4, 0.2)
    oracle = partial(velocity, mechanism, "tip", jnp.array(point), axes)
    options = {"point": point, "axes": axes}
    for order in (2, 3):
        chosen = directions[: order - 1]
        wanted = jax.jacfwd(along(partial(oracle, v=v), chosen))(q)
        found = mechanism.frame_velocity_derivative(q, v, "tip", order=order, along=chosen, **options)
        np.testing.assert_allclose(found, wanted, atol=1e-12 * max(1.0, np.abs(wanted).max()))
        full = mechanism.frame_jacobian_derivative(q, "tip", order=order, **options)
        assert full.shape == (6, *[mechanism.nq] * (order + 1))
        by_v = mechanism.frame_jacobian_derivative(q, "tip", order=order, along=chosen, **options)
        for direction in chosen:
            full = full @ direction
        np.testing.assert_allclose(full, by_v, atol=1e-12 * max(1.0, np.abs(by_v).max()))
        # Linear in the velocity: each column of the Jacobian is the velocity for a unit one.
        column = int(rng.integers(mechanism.nq))
        unit = jnp.eye(mechanism.nq)[column]
        wanted = jax.jacfwd(along(partial(oracle, v=unit), chosen))(q)
        np.testing.assert_allclose(by_v[:, column], wanted, atol=1e-12 * max(1.0, np.abs(by_v).max()))
        np.testing.assert_allclose(np.einsum("ai...,i->a...", by_v, v), found, atol=1e-12 * np.abs(found).max())
        assert np.abs(found).max() > 0.1


def test_derivatives_of_frames_take_batches(mechanism):
    rng = np.random.default_rng(12)
    q, v = rng.uniform(-1.0, 1.0, (2, 3, mechanism.nq))
    d = rng.uniform(-1.0, 1.0, mechanism.nq)
    poses = mechanism.frame_pose_derivative(q, "tip", order=2, along=[d])
    speeds = mechanism.frame_velocity_derivative(q, v, "tip", order=2)
    columns = mechanism.frame_jacobian_derivative(q, "tip", order=2, along=[d], axes="frame")
    assert poses.shape == (3, 4, 4, mechanism.nq)
    for k in range(3):
        np.testing.assert_allclose(
            poses[k], mechanism.frame_pose_derivative(q[k], "tip", order=2, along=[d]), atol=1e-14
        )
        np.testing.assert_allclose(
            speeds[k], mechanism.frame_velocity_derivative(q[k], v[k], "tip", order=2), atol=1e-14
        )
        one = mechanism.frame_jacobian_derivative(q[k], "tip", order=2, along=[d], axes="frame")
        np.testing.assert_allclose(columns[k], one, atol=1e-14)
    fixed = mechanism.frame_pose_derivative(q, "world", order=2)
    assert fixed.shape == (3, 4, 4, mechanism.nq, mechanism.nq)
    assert not fixed.any()
    assert not mechanism.frame_velocity_derivative(q, v, "world").any()
    assert not mechanism.frame_jacobian_derivative(q, "world", order=2, axes="frame").any()


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda m, q: m.frame_pose_derivative(q, "tp"), "unknown frame 'tp'; did you mean"),
        (lambda m, q: m.frame_pose_derivative(q, "tip", order=0), "order: got 0, expected a whole number, at least 1"),
        (lambda m, q: m.frame_pose_derivative(q, "tip", along=[q, q]), "got 2 directions for derivatives of order 1"),
        (lambda m, q: m.frame_pose_derivative(q, "tip", along=[q[:-1]]), r"along: got shape \(1, "),
        (lambda m, q: m.frame_pose_derivative(q, "tip", along=q), r"along: got shape"),
        (lambda m, q: m.frame_pose_derivative(q, "tip", order=14), "takes .* MB.*along=.*allow more"),
        (
            lambda m, q: m.frame_jacobian_derivative(q, "tip", order=3, max_bytes=1e4),
            "frame_jacobian_derivative: .* MB",
        ),
        (lambda m, q: m.frame_velocity_derivative(q, q, "tip", order=4, max_bytes=1e4), "takes .* 0.01 MB"),
        (lambda m, q: m.frame_velocity_derivative(q, q[:-1], "tip"), "v: got shape"),
    ],
)
def test_bad_questions_about_derivatives_of_frames_are_named(mechanism, ask, message):
    with pytest.raises(ArgumentError, match=message):
        ask(mechanism, np.zeros(mechanism.nq))


def test_frame_jacobians_are_the_derivatives_of_positions(mechanism):
    """Against differences of `positions`, which the core computes: to their accuracy."""
    q = np.random.default_rng(8).uniform(-1, 1, mechanism.nq)
    h = 1e-6
    for name in mechanism.frames:
        J = mechanism.frame_jacobian(q, name)
        for i in range(mechanism.nq):
            step = h * np.eye(mechanism.nq)[i]
            ahead, behind = (mechanism.positions(q + s * step, [name])[0] for s in (1, -1))
            np.testing.assert_allclose(J[:3, i], (ahead - behind) / (2 * h), atol=1e-8)


def test_second_derivatives_of_positions_commute(mechanism):
    q = np.random.default_rng(9).uniform(-1, 1, mechanism.nq)
    dJ = mechanism.frame_jacobian_derivative(q, "tip")
    np.testing.assert_allclose(dJ[:3], dJ[:3].swapaxes(1, 2), atol=1e-14)
    assert np.abs(dJ[3:] - dJ[3:].swapaxes(1, 2)).max() > 0.1


def test_questions_about_frames_take_batches(mechanism):
    rng = np.random.default_rng(10)
    q, v = rng.uniform(-1, 1, (2, 4, mechanism.nq))
    m, tip = mechanism, "tip"
    for axes in ("world", "frame"):
        for k in range(4):
            for batch, one in (
                (m.frame_velocity(q, v, tip, axes=axes), m.frame_velocity(q[k], v[k], tip, axes=axes)),
                (m.frame_jacobian(q, tip, axes=axes), m.frame_jacobian(q[k], tip, axes=axes)),
                (
                    m.frame_jacobian_derivative(q, tip, axes=axes),
                    m.frame_jacobian_derivative(q[k], tip, axes=axes),
                ),
                (m.center_of_mass(q), m.center_of_mass(q[k])),
                (m.total_momentum(q, v), m.total_momentum(q[k], v[k])),
            ):  # fmt: skip
                np.testing.assert_allclose(batch[k], one, rtol=1e-13, atol=1e-14)


def test_frames_that_do_not_move_have_no_velocity():
    mechanism = Mechanism(every_joint())
    q, v = np.random.default_rng(11).uniform(-1, 1, (2, mechanism.nq))
    for name in ("world", "post"):
        for axes in ("world", "frame"):
            assert not mechanism.frame_velocity(q, v, name, axes=axes).any()
            assert mechanism.frame_jacobian(q, name, axes=axes).shape == (6, mechanism.nq)
            derivative = mechanism.frame_jacobian_derivative(q, name, axes=axes)
            assert derivative.shape == (6, mechanism.nq, mechanism.nq)
            assert not derivative.any()


def bodies_moving(mechanism, q, v):
    """Mass, and the integrals of x, x-dot and x x-dot^T over all bodies, by their pseudo-inertias."""
    mass, moment, momentum, product = 0.0, np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for frame in mechanism.tree.frames[1:]:
        for body in frame.frame.bodies:
            c = body.com
            J = np.zeros((4, 4))
            J[:3, :3] = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
            J[:3, :3] += body.mass * np.outer(c, c)
            J[:3, 3] = J[3, :3] = body.mass * c
            J[3, 3] = body.mass
            G, G_dot = jax.jvp(partial(frame_pose, mechanism, frame.name), (q,), (v,))
            mass += body.mass
            moment += np.asarray(G @ J)[:3, 3]
            momentum += np.asarray(G_dot @ J)[:3, 3]
            product += np.asarray(G @ J @ G_dot.T)[:3, :3]
    return mass, moment, momentum, product


def test_mass_centre_and_momentum_of_all_bodies(mechanism):
    rng = np.random.default_rng(12)
    for q, v in rng.uniform(-1.5, 1.5, (3, 2, mechanism.nq)):
        mass, moment, momentum, P = bodies_moving(mechanism, q, v)
        assert mechanism.mass == pytest.approx(mass, rel=1e-15)
        np.testing.assert_allclose(mechanism.center_of_mass(q), moment / mass, atol=1e-12)
        angular = [P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]]
        np.testing.assert_allclose(mechanism.total_momentum(q, v), [*momentum, *angular], rtol=1e-12, atol=1e-12)


def test_total_momentum_is_that_of_the_variables_that_move_everything():
    mechanism = Mechanism(
        [free("b", axes="xyz", **HEAVY), [ball("c", axes="xyz", **HEAVY), tx(0.5), [rz("d", **HEAVY)]]]
    )
    q, v = np.random.default_rng(13).uniform(-1, 1, (2, mechanism.nq))
    np.testing.assert_allclose(mechanism.total_momentum(q, v)[:3], mechanism.momentum(q, v)[:3], rtol=1e-13)


def test_total_momentum_is_kept_where_nothing_acts():
    mechanism = Mechanism(
        [free("b", axes="xyz", **HEAVY), [tx(0.5), [rx("c", **HEAVY), [ty(0.3), [rz("d", **HEAVY)]]]]]
    )
    vi = MidpointVI(mechanism)
    q = np.zeros(mechanism.nq)
    v = np.random.default_rng(14).uniform(-0.5, 0.5, mechanism.nq)
    motion = vi.simulate(vi.start(q, v), np.linspace(0.0, 0.5, 501))
    momenta = mechanism.total_momentum(0.5 * (motion.q[1:] + motion.q[:-1]), motion.v)
    drift = np.abs(momenta - momenta[0]).max(axis=0) / np.abs(momenta[0]).max()
    assert drift[:3].max() < 1e-11
    # The scheme keeps the momentum of its own variables; the angular one follows to its order.
    assert drift[3:].max() < 1e-7
    gravity = Mechanism([free("b", axes="xyz", **HEAVY)], [Gravity((0, 0, -10.0))])
    vi = MidpointVI(gravity)
    fall = vi.simulate(vi.start(np.zeros(6)), np.linspace(0.0, 0.5, 101))
    middle = gravity.total_momentum(0.5 * (fall.q[1:] + fall.q[:-1]), fall.v)
    times = 0.5 * (fall.t[1:] + fall.t[:-1])
    np.testing.assert_allclose(middle[:, 2], -10.0 * 0.7 * times, atol=1e-11)


# Rank


def four_bar(**options):
    """A parallelogram whose bars lie in one line at q = 0."""
    return Mechanism(
        [
            rz("left"), [tx(1.0, name="a", mass=1.0)],
            tx(3.0), [rz("right"), [tx(1.0, name="b", mass=1.0)]],
        ],
        [Distance("a", "b", 3.0, name="coupler")],
        **options,
    )  # fmt: skip


def test_rank_counts_what_the_constraints_really_ask():
    mechanism = four_bar()
    generic = np.array([0.7, 0.7])
    assert mechanism.redundancy(generic) == {}
    assert (mechanism.constraint_rank(generic), mechanism.degrees_of_freedom(generic)) == (1, 1)
    # In one line no motion changes the distance to first order.
    assert mechanism.redundancy([0.0, 0.0]) == {"coupler": ()}
    assert mechanism.degrees_of_freedom([0.0, 0.0]) == 2


def test_redundant_equations_are_named_with_those_that_they_repeat():
    two_strings = four_bar().with_elements(
        [Distance("a", "b", 3.0, name="again"), Distance("a", "world", 2.0, name="other")]
    )
    q = np.array([0.7, 0.4])
    found = two_strings.redundancy(q)
    # The second string repeats the first; the distance of `a` from the axis of its own bar never changes.
    assert found == {"again": ("coupler",), "other": ()}
    assert two_strings.constraint_rank(q) == 1


def test_a_planar_loop_closed_in_space_is_redundant_out_of_its_plane():
    mechanism = Mechanism(
        [
            rz("p"), [tx(1.0, mass=1.0), [rz("q"), [tx(1.0, name="end", mass=1.0)]]],
            tx(1.2, name="wall"), [tz("lift", mass=1.0), [rx("turn", name="pin", mass=1.0, com=(0, 1, 0))]],
        ],
        [PointToPoint("end", "pin", name="pin joint"), PointToPoint("wall", "pin", name="guide")],
    )  # fmt: skip
    names = mechanism.constraints
    q = np.array([0.9, -1.8, 0.0, 0.3])
    found = mechanism.redundancy(q)
    # Of the pin only z can move: one equation asks that of it, another repeats it, x and y of the guide ask nothing.
    assert set(found.values()) <= {(), (names[2],)}
    assert len(found) == 3
    assert mechanism.constraint_rank(q) == 3
    assert mechanism.degrees_of_freedom(q) == 1


def test_prescribed_variables_do_not_count():
    mechanism = Mechanism(
        [tx("k", kinematic=True, name="hook"), tz(-1.0), [tx("x", name="bob", mass=1.0)]],
        [Distance("hook", "bob", 1.5, name="rope")],
    )
    assert mechanism.redundancy([0.0, 0.0]) == {"rope": ()}
    assert mechanism.constraint_rank([1.0, 0.0]) == 1


def test_broken_questions():
    mechanism = Mechanism(every_joint())
    q = np.zeros(mechanism.nq)
    for ask, message in (
        (lambda: mechanism.frame_jacobian(q, "tipp"), "unknown frame 'tipp'.*'tip'"),
        (lambda: mechanism.frame_jacobian(q, "tip", axes="body"), "axes.*'body'.*'frame'"),
        (lambda: mechanism.frame_jacobian(q, "tip", point=(0, 0)), r"point.*\(3,\)"),
        (lambda: mechanism.frame_jacobian(q[1:], "tip"), "q: got shape"),
        (lambda: mechanism.frame_velocity(q, q[1:], "tip"), "v: got shape"),
        (lambda: mechanism.frame_velocity([q, q], [q], "tip"), "v: got shape"),
        (lambda: mechanism.total_momentum(q, np.full(len(q), np.nan)), "v: got nan at index"),
        (lambda: Mechanism([rx("k", kinematic=True)]).center_of_mass([0.0]), "no mass"),
    ):
        with pytest.raises(ArgumentError, match=message):
            ask()
