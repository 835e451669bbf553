"""Derivatives of steps and of whole trajectories by the named parameters.

A step is a smooth function of each number, computed to rounding, so that the steps of mechanisms with other numbers
tell its derivative: central differences at four widths, extrapolated to width zero, have an error of the eighth order.
For a pendulum on a cart the step is written out by hand here, with derivatives by JAX.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from derivatives.differences import extrapolated
from derivatives.parameter_cases import forces, loops, springs
from leastaction import mechanics as la
from leastaction.errors import ArgumentError, DescriptionError, StepError
from leastaction.mechanics import Mechanism, MidpointVI, State, Trajectory, rx
from leastaction.mechanics.discrete.midpoint import Split
from leastaction.mechanics.discrete.step_sensitivity import momentum_by
from leastaction.mechanics.elements import kinds
from leastaction.mechanics.elements.base import Element

DT = 0.1
MOMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
SPLITS: tuple[Split, ...] = ("symmetric", "left")
# Of the largest entry of a column's q, p and lam; entries below the floor count as that large. The rounding of the
# steps, 1e-14, over the widths of the differences leaves about 1e-11.
TOLERANCE, FLOOR = 5e-10, 0.1


# The weight of these is another number, that of gravity on some frames.
REFUSED = {("forces", f"hand.{field}") for field in ("mass", "com.x", "com.y", "com.z")}

MAKERS: dict[str, Callable[[], Mechanism]] = {"springs": springs, "forces": forces, "loops": loops}


@dataclass(frozen=True)
class Case:
    """A mechanism and a state of it in motion, and what acts on it over a step."""

    mechanism: Mechanism
    start: State
    v: np.ndarray
    u: np.ndarray
    rho: np.ndarray

    def step(self, mechanism: Mechanism, split: Split) -> Trajectory:
        vi = MidpointVI(mechanism, split=split, threads=1)
        run = vi.simulate(self.start, [0.0, DT], inputs=self.u, rho=self.rho)
        assert run.steps == 1, run.message
        return run


@cache
def case(name: str) -> Case:
    m = MAKERS[name]()
    rng = np.random.default_rng([7, *name.encode()])
    guess = rng.uniform(0.2, 0.6, m.nq)
    q = la.project_configuration(m, guess).q
    v = la.project_velocity(m, q, rng.uniform(-1.0, 1.0, m.nq)).v
    start = MidpointVI(m).start(q, v)
    return Case(m, start, v, rng.uniform(0.5, 2.0, m.nu), (q + DT * v)[m.nd :])


def width(name: str, value: float) -> float:
    """A fiftieth of the number, or of what is usual; inertias must stay those of a body."""
    if ".inertia." in name:
        return 3e-3
    return 0.02 * max(abs(value), 0.3)


def parameters_of(name: str) -> list[str]:
    """Return the parameters by which a step has derivatives; `test_errors` has the others."""
    return [p for p in MAKERS[name]().parameters if (name, p) not in REFUSED]


def agrees(got: np.ndarray, wanted: np.ndarray, m: Mechanism) -> bool:
    """Whether columns [q; p; v_rho; lam] agree, each part relative to its size."""
    for part in (slice(0, m.nq), slice(m.nq, m.nx), slice(m.nx, None)):
        scale = max(np.abs(wanted[part]).max(initial=0.0), FLOOR)
        if np.abs(got[part] - wanted[part]).max(initial=0.0) > TOLERANCE * scale:
            return False
    return True


# Without forces there is nothing to split.
COMBINATIONS = [("springs", "symmetric"), *((n, s) for n in ("forces", "loops") for s in SPLITS)]


@pytest.mark.parametrize(("name", "split"), COMBINATIONS)
def test_every_parameter(name: str, split: Split) -> None:
    c, names = case(name), parameters_of(name)
    m = c.mechanism
    found = MidpointVI(m, split=split, threads=1).differentiate_by(c.step(m, split), names)
    assert found.names == tuple(names)
    columns = np.concatenate([found.x[0], found.lam[0]]).T
    wrong = {}
    for parameter, got in zip(names, columns, strict=True):

        def step(number: float, parameter: str = parameter) -> np.ndarray:
            run = c.step(m.with_parameters({parameter: number}), split)
            return np.concatenate([run.x[1], run.lam[0]])

        value = m.parameters[parameter]
        wanted = extrapolated(step, value, width(parameter, value))
        if not agrees(got, wanted, m):
            wrong[parameter] = (got, wanted)
    assert not wrong


def test_what_the_mechanisms_hold() -> None:
    """Every kind of parameter is among them, and moves something."""
    every = {p for name in MAKERS for p in parameters_of(name)}
    assert every >= {
        *("cart.mass", "upper.body2.mass", "upper.com.x", "tip.inertia.xy"),  # bodies
        *("foot.value", "tilt.value", "arm.value", "bend.value", "drop.value"),  # lengths, angles
        *("hook.translation.x", "tip.translation.y"),  # where something is attached
        *("spring.stiffness", "spring.length", "joint.rest", "joint.factors.e", "torsion.rest"),
        *("curve.scale", "string.length", "string.smoothing", "attraction.strength"),
        *("user.strength", "user.softening", "some.mass.hand", "motor.emf", "motor.bend"),
        *("damping.x", "damping.b", "cubic.c5", "friction.force", "friction.speed"),
        *("damper.coefficient", "air.exponent", "air.wind.y", "tendon.gain"),
        *("body.fx", "body.tz", "hybrid.fy", "spatial.tx"),
        *("rod.length", "rope.length", "gear.offset", "gear.factors.a", "user.slope"),
        *("gravity.vector.x", "gravity.vector.y", "some.vector.z"),
        *("hand.factor.e", "hand.factor.d", "hand.offset", "nut.pitch"),  # of joints
    }
    for name in MAKERS:
        c, names = case(name), parameters_of(name)
        vi = MidpointVI(c.mechanism, threads=1)
        d = vi.differentiate_by(c.step(c.mechanism, "symmetric"), names)
        size = np.abs(np.concatenate([d.x[0], d.lam[0]])).max(axis=0)
        still = {n for n, largest in zip(names, size, strict=True) if largest == 0.0}
        # The upper arm only turns about its z axis, the cart only slides, the other's base turns about y.
        turns = [f"{body}.inertia.{e}" for body in ("upper", "upper.body2") for e in MOMENTS]
        assert still <= {
            *(n for n in turns if not n.endswith("zz")),
            *(f"{body}.com.z" for body in ("upper", "upper.body2")),
            *(f"cart.inertia.{e}" for e in MOMENTS),
            *(f"cart.com.{a}" for a in "xyz"),
            *(f"other.inertia.{e}" for e in MOMENTS if e != "yy"),
            "other.com.y",
        }


def elements_of(kind: type[Element]) -> Iterator[type[Element]]:
    for found in kind.__subclasses__():
        yield from elements_of(found)
        yield found


def test_the_numbers_that_are_no_parameters() -> None:
    """Of elements those of which `docs/mechanisms.md` says so, and no others; nor are the axes of joints."""
    held = {
        f"{element.__name__}.{field.name}"
        for element in elements_of(Element)
        for field in dataclasses.fields(element)
        if element.__module__.startswith("leastaction.")
        and isinstance(field.metadata.get("kind"), kinds.Axis | kinds.Rotation | kinds.SmoothCurve)
    }
    assert held == {
        *("TorsionalSpring.axis", "Motor.axis", "HingeLoop.axis", "PointOnLine.direction", "PointOnPlane.normal"),
        "FixedOrientation.rotation",
        *("NonlinearSpring.force", "TendonForce.force_length", "TendonForce.force_velocity"),
    }
    for make in MAKERS.values():
        m = make()
        numbers = {f"{name}.{number}" for name, element in m.elements.items() for number in element.numbers}
        # The damping of all variables that have none of their own is the parameter of each; a string that pushes too
        # has nothing to smooth, and a spring without a length another law.
        assert numbers - set(m.parameters) <= {"damping.default", "both_ways.smoothing", "tie.length"}
        for placed in m.tree.frames[1:]:
            frame, own = placed.frame, {p for p in m.parameters if p.startswith(f"{placed.name}.")}
            if frame.transform == "screw":
                assert f"{placed.name}.pitch" in own
            if frame.coordinate is not None and not frame.coordinate.plain:
                wanted = {f"factor.{name}" for name in frame.variables} | {"offset"} if frame.variables else {"value"}
                assert {f"{placed.name}.{field}" for field in wanted} <= own


def test_factors_that_cannot_be() -> None:
    m = springs()
    with pytest.raises(DescriptionError, match="frame 'hand': the factor of 'e' is 0"):
        m.with_parameters({"hand.factor.e": 0.0})
    turned = m.with_parameters({"nut.pitch": -0.2, "hand.offset": 0.1})
    assert (turned.parameters["nut.pitch"], turned.parameters["hand.offset"]) == (pytest.approx(-0.2), 0.1)
    assert "-0.2 m/rad" in str(turned)
    plain = Mechanism([rx(2.0 * la.var("a"), name="wheel", mass=1.0, inertia=(1.0, 1.0, 1.0))])
    once = plain.with_parameters({"wheel.factor.a": 1.0})  # of another structure: a coordinate that is a variable
    assert once.core.n_joints == 1
    assert "wheel.factor.a" not in once.parameters
    assert once.mass_matrix([0.3])[0, 0] == pytest.approx(1.0)


def test_bodies_on_one_frame_add_up() -> None:
    """Two names for one thing: the same inertia on a frame, the same length in a chain of two."""
    c = case("loops")
    run = c.step(c.mechanism, "symmetric")
    names = ["upper.inertia.zz", "upper.body2.inertia.zz"]
    d = MidpointVI(c.mechanism, threads=1).differentiate_by(run, names)
    np.testing.assert_array_equal(d.x[..., 0], d.x[..., 1])
    m = Mechanism(
        [rx("a"), [la.ty(-0.4, name="first"), [la.ty(-0.3, name="second", mass=1.0)]]],
        [la.Gravity((0.0, -9.8, 1.0))],
    )
    vi = MidpointVI(m)
    both = vi.differentiate_by(vi.simulate(vi.start([0.7], [1.0]), [0.0, 0.1, 0.2]), ["first.value", "second.value"])
    np.testing.assert_allclose(both.x[..., 0], both.x[..., 1], rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("again", [False, True])
def test_redundant_constraints(again: bool) -> None:
    """A plane loop that is closed in space, or twice: the motion is unique, the multiplier the least one."""
    root = la.world()
    crank = root.rz("a", name="crank", mass=1.0, com=(0.5, 0.0, 0.0)).tx(1.0, name="pin")
    crank.rz("b", name="bar", mass=1.0, com=(0.5, 0.0, 0.0)).tx(1.3, name="end")
    root.tx(1.5, name="foot").rz("c", mass=1.0, com=(0.5, 0.0, 0.0)).tx(1.1, name="top")
    closed = [la.PointToPoint("end", "top", "xyz"), la.PointToPoint("top", "end", "xy")]
    m = Mechanism(root, [la.Gravity((0.0, -9.8, 0.0)), la.Damping(0.1), *closed[: 1 + again]])
    q = la.project_configuration(m, [1.2, -1.0, 1.4]).q
    start = MidpointVI(m).start(q, la.project_velocity(m, q, [1.0, 0.0, 0.0]).v)

    def step(mechanism: Mechanism) -> Trajectory:
        run = MidpointVI(mechanism).simulate(start, [0.0, 0.02])
        assert run.steps == 1, run.message
        assert run.rank_deficient
        return run

    names = ["crank.mass", "bar.com.y", "damping.b", "pin.value", "foot.value", "end.value"]
    found = MidpointVI(m).differentiate_by(step(m), names)
    for column, parameter in enumerate(names):

        def rolled(number: float, parameter: str = parameter) -> np.ndarray:
            run = step(m.with_parameters({parameter: number}))
            return np.concatenate([run.x[1], run.lam[0]])

        value = m.parameters[parameter]
        wanted = extrapolated(rolled, value, 0.005)
        got = np.concatenate([found.x[0, :, column], found.lam[0, :, column]])
        assert agrees(got, wanted, m), parameter


def test_momentum() -> None:
    c, names = case("loops"), parameters_of("loops")
    m, q = c.mechanism, c.start.q
    got = momentum_by(m, q, c.v, names)
    for column, parameter in enumerate(names):

        def momentum(number: float, parameter: str = parameter) -> np.ndarray:
            return m.with_parameters({parameter: number}).momentum(q, c.v)[: m.nd]

        value = m.parameters[parameter]
        wanted = extrapolated(momentum, value, width(parameter, value))
        np.testing.assert_allclose(got[:, column], wanted, atol=1e-10, err_msg=parameter)


TRAJECTORY = {
    "springs": ["cart.mass", "spring.stiffness", "user.strength", "hook.translation.x", "tilt.value"],
    "forces": ["lower.mass", "damping.a", "friction.force", "tendon.gain", "motor.emf", "arm.value"],
    "loops": ["upper.mass", "hand.com.x", "hand.inertia.xx", "spring.stiffness", "damping.a"],
}  # fmt: skip


@pytest.mark.parametrize(("name", "split"), COMBINATIONS)
def test_a_trajectory_from_a_velocity(name: str, split: Split) -> None:
    """The start's momentum moves with the masses; later states move with everything."""
    c, names = case(name), TRAJECTORY[name]
    m = c.mechanism
    t = np.linspace(0.0, 0.6, 31)
    rho = c.start.q[m.nd :] + c.v[m.nd :] * t[1:, None]

    def simulated(other: Mechanism) -> Trajectory:
        vi = MidpointVI(other, split=split, threads=1)
        run = vi.simulate(vi.start(c.start.q, c.v), t, inputs=c.u, rho=rho)
        assert run.steps == 30, run.message
        return run

    vi = MidpointVI(m, split=split, threads=1)
    found = vi.sensitivity(simulated(m), names, v=c.v)
    assert found.x.shape == (31, m.nx, len(names))
    assert found.lam.shape == (30, m.nc, len(names))
    for column, parameter in enumerate(names):

        def rolled(number: float, parameter: str = parameter) -> np.ndarray:
            run = simulated(m.with_parameters({parameter: number}))
            return np.concatenate([run.x.ravel(), run.lam.ravel()])

        value = m.parameters[parameter]
        # Narrow, as the motions soon differ: a wide one has curves of forces on other pieces.
        wanted = extrapolated(rolled, value, width(parameter, value) / 4.0)
        got = np.concatenate([found.x[..., column].ravel(), found.lam[..., column].ravel()])
        error = np.abs(got - wanted).max() / max(1.0, np.abs(wanted).max())
        assert error < 1e-9, parameter


def test_a_trajectory_from_a_momentum() -> None:
    """Without v the start is a state that depends on nothing; dx0 says how it does depend."""
    c, names = case("springs"), ["cart.mass", "spring.length"]
    m = c.mechanism
    vi = MidpointVI(m, threads=1)
    run = vi.simulate(c.start, np.linspace(0.0, 0.3, 16))
    plain = vi.sensitivity(run, names)
    assert not plain.x[0].any()
    dx0 = np.zeros((m.nx, 2))
    dx0[m.nq : m.nq + m.nd] = momentum_by(m, c.start.q, c.v, names)
    np.testing.assert_array_equal(vi.sensitivity(run, names, dx0=dx0).x, vi.sensitivity(run, names, v=c.v).x)
    steps = vi.differentiate_by(run, names)
    np.testing.assert_array_equal(plain.x[1], steps.x[0])


def test_a_variable_may_have_the_name_of_a_length() -> None:
    m = Mechanism(
        [
            rx("rod.value"),
            [la.ty(-0.5, name="rod", mass=1.0)],
            la.tx("rod.value'", kinematic=True),
        ],
        [la.Gravity((0.0, -9.8, 1.0))],
    )
    vi = MidpointVI(m)

    def rolled(length: float) -> np.ndarray:
        other = vi.like(m.with_parameters({"rod.value": length}))
        return other.simulate(other.start([0.7, 0.0], [1.0, 0.0]), np.linspace(0.0, 0.4, 5)).x

    run = vi.simulate(vi.start([0.7, 0.0], [1.0, 0.0]), np.linspace(0.0, 0.4, 5))
    got = vi.sensitivity(run, ["rod.value"], v=[1.0, 0.0])
    np.testing.assert_allclose(got.x[..., 0], extrapolated(rolled, -0.5, 0.01), atol=1e-9)


def slider_crank(rod: float = 2.0) -> Mechanism:
    """A slider on a line whose rod, of a length that is a number, closes the loop with a crank that weighs."""
    return Mechanism(
        [
            rx("crank"),
            [la.ty(1.0, name="pin", mass=1.0)],
            la.ty("slider"),
            [la.tz(0.0, name="block", mass=2.0)],
        ],
        [la.Gravity((0, 0, -9.81)), la.Distance("pin", "block", rod, name="rod")],
    )


def assembled(m: Mechanism) -> np.ndarray:
    """Return the start with the crank held, or nothing held."""
    return la.project_configuration(m, [0.6, 2.6], hold=["crank"], tolerance=1e-14).q


def test_a_length_in_a_closed_loop_moves_the_start() -> None:
    t = np.linspace(0.0, 0.6, 31)

    def rolled(length: float) -> np.ndarray:
        other = slider_crank(length)
        vi = MidpointVI(other, threads=1)
        run = vi.simulate(vi.start(assembled(other)), t)
        assert run.steps == 30, run.message
        return np.concatenate([run.x.ravel(), run.lam.ravel()])

    vi = MidpointVI(slider_crank(), threads=1)
    run = vi.simulate(vi.start(assembled(vi.mechanism)), t)
    wanted = extrapolated(rolled, 2.0, 0.01)
    for options in ({}, {"v": [0.0, 0.0]}):
        found = vi.sensitivity(run, ["rod.length"], hold=["crank"], **options)
        got = np.concatenate([found.x.ravel(), found.lam.ravel()])
        np.testing.assert_allclose(got, wanted, atol=1e-8 * np.abs(wanted).max())
        assert found.x[0, 0, 0] == 0.0
        assert found.x[0, 1, 0] > 1.0


@pytest.mark.parametrize("hold", [["crank"], []])
def test_a_length_in_a_closed_loop_turns_the_velocity_of_the_start(hold: list[str]) -> None:
    """By an element's length, and by those of frames and an inertia, against starts that are assembled anew."""
    t = np.linspace(0.0, 0.4, 21)
    q0, v0 = assembled(slider_crank()), np.array([1.5, 0.0])
    v0 = la.project_velocity(slider_crank(), q0, v0, hold=["crank"]).v
    for name, value in (("rod.length", 2.0), ("pin.value", 1.0), ("pin.mass", 1.0), ("block.value", 0.0)):

        def rolled(number: float, name: str = name) -> np.ndarray:
            m = slider_crank().with_parameters({name: number})
            # The least change in q and in v, from the same start.
            q = la.project_configuration(m, q0, hold=hold, tolerance=1e-14).q
            v = la.project_velocity(m, q, v0, hold=hold).v
            vi = MidpointVI(m, threads=1)
            run = vi.simulate(vi.start(q, v), t)
            assert run.steps == 20, run.message
            return np.concatenate([run.x.ravel(), run.lam.ravel()])

        vi = MidpointVI(slider_crank(), threads=1)
        run = vi.simulate(vi.start(q0, v0), t)
        found = vi.sensitivity(run, [name], v=v0, hold=hold)
        got = np.concatenate([found.x.ravel(), found.lam.ravel()])
        wanted = extrapolated(rolled, value, 0.01)
        np.testing.assert_allclose(got, wanted, atol=1e-7 * np.abs(wanted).max(), err_msg=name)


def test_a_velocity_that_a_parameter_turns_needs_to_be_told_how_it_follows() -> None:
    """A gear's factor changes no constraint where its variable is zero, but the rates."""
    m = Mechanism(
        [la.rx("a"), [la.tz(-1.0, mass=1.0)], la.rx("b"), [la.tz(-1.0, mass=1.0)]],
        [la.Coupling({"a": 2.0, "b": -1.0}, name="gear")],
    )
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.0, 0.0], [1.0, 2.0]), 0.01 * np.arange(4))
    with pytest.raises(ArgumentError, match=r"v does not keep the constraint 'gear' as .*'gear.factors.a'.*hold="):
        vi.sensitivity(run, ["gear.factors.a"], v=[1.0, 2.0])
    found = vi.sensitivity(run, ["gear.factors.a"], v=[1.0, 2.0], hold=["a"])
    # p = dL/dv: the inertias are 1, and the rate of b is the factor's times that of a.
    np.testing.assert_allclose(found.x[0, :, 0], [0.0, 0.0, 0.0, 1.0], atol=1e-11)
    with pytest.raises(ArgumentError, match=r"hold: the velocity .* of 'a', 'b' held; hold fewer"):
        vi.sensitivity(run, ["gear.factors.a"], v=[1.0, 2.0], hold=["a", "b"])


def test_a_length_in_a_closed_loop_needs_to_be_told_how_the_start_follows() -> None:
    vi = MidpointVI(slider_crank(), threads=1)
    m, names = vi.mechanism, ["rod.length", "pin.mass"]
    q = assembled(m)
    v = la.project_velocity(m, q, [1.0, 0.0]).v
    run, moving = (vi.simulate(vi.start(q, v0), 0.02 * np.arange(4)) for v0 in (None, v))
    with pytest.raises(ArgumentError, match=r"'rod.length' changes the constraint 'rod'.*hold="):
        vi.sensitivity(run, names)
    with pytest.raises(ArgumentError, match=r"'rod.length' changes the constraint 'rod'.*hold="):
        vi.sensitivity(moving, names, v=v)
    with pytest.raises(ArgumentError, match=r"with 'crank', 'slider' held nothing keeps .* 'rod'"):
        vi.sensitivity(run, names, hold=["crank", "slider"])
    with pytest.raises(ArgumentError, match=r"hold: unknown variable 'crnk'.*'crank'"):
        vi.sensitivity(run, names, hold=["crnk"])
    with pytest.raises(ArgumentError, match="both hold and dx0"):
        vi.sensitivity(run, names, hold=[], dx0=np.zeros((m.nx, 2)))
    # A mass moves no constraint, and who says how the start depends is believed.
    assert not vi.sensitivity(run, ["pin.mass"]).x[0].any()
    assert not vi.sensitivity(run, names, dx0=np.zeros((m.nx, 2))).x[0].any()
    nearest = vi.sensitivity(run, names, hold=[]).x[0, :2, 0]
    C = m.constraint_jacobian(q)[0]
    np.testing.assert_allclose(nearest, C * (C @ nearest) / (C @ C), rtol=1e-12)


NUMBERS = {
    "cart.mass": 3.0,
    "bob.mass": 0.7,
    "bob.value": -0.8,
    "damping.x": 0.4,
    "damping.theta": 0.1,
    "spring.stiffness": 5.0,
    "spring.rest": 0.2,
}


@pytest.mark.parametrize("split", SPLITS)
def test_a_pendulum_on_a_cart_by_hand(split: Split) -> None:
    """The step's equations written out, solved and differentiated implicitly by JAX, along a trajectory."""
    jax = pytest.importorskip("jax")
    jnp = jax.numpy
    names = list(NUMBERS)
    m = Mechanism(
        [la.tx("x", name="cart", mass=3.0), [la.rz("theta"), [la.ty(-0.8, name="bob", mass=0.7)]]],
        [
            la.Gravity((0.0, -9.8, 0.0)),
            la.Damping({"x": 0.4, "theta": 0.1}),
            la.JointSpring("x", 5.0, rest=0.2, name="spring"),
        ],
    )
    before, after = (0.5, 0.5) if split == "symmetric" else (1.0, 0.0)

    def lagrangian(q: object, v: object, th: object) -> object:
        M, mass, y, _, _, k, rest = th
        bob = jnp.array([v[0] - y * jnp.cos(q[1]) * v[1], -y * jnp.sin(q[1]) * v[1]])
        kinetic = 0.5 * M * v[0] ** 2 + 0.5 * mass * bob @ bob
        return kinetic - mass * 9.8 * y * jnp.cos(q[1]) - 0.5 * k * (q[0] - rest) ** 2

    def discrete(a: object, b: object, th: object) -> object:
        return DT * lagrangian((a + b) / 2, (b - a) / DT, th)

    def damping(a: object, b: object, th: object) -> object:
        return -th[3:5] * (b - a)  # times dt

    def residual(q2: object, x: object, th: object) -> object:
        q1, p1 = x[:2], x[2:]
        return p1 + jax.grad(discrete)(q1, q2, th) + before * damping(q1, q2, th)

    def end(q2: object, x: object, th: object) -> object:
        return jax.grad(discrete, argnums=1)(x[:2], q2, th) + after * damping(x[:2], q2, th)

    @jax.jit
    def advanced(q2: object, x: object, dx: object, th: object) -> object:
        """Return the next state near q2, and its derivatives by implicit differentiation."""
        for _ in range(2):
            q2 = q2 - jnp.linalg.solve(jax.jacfwd(residual)(q2, x, th), residual(q2, x, th))
        F_q2, F_x, F_th = jax.jacfwd(residual, argnums=(0, 1, 2))(q2, x, th)
        e_q2, e_x, e_th = jax.jacfwd(end, argnums=(0, 1, 2))(q2, x, th)
        dq2 = -jnp.linalg.solve(F_q2, F_x @ dx + F_th)
        slopes = jnp.vstack([dq2, e_q2 @ dq2 + e_x @ dx + e_th])
        return jnp.concatenate([q2, end(q2, x, th)]), slopes

    vi = MidpointVI(m, split=split)
    v0 = np.array([0.3, -1.0])
    run = vi.simulate(vi.start([0.1, 1.2], v0), DT * np.arange(21))
    found = vi.sensitivity(run, names, v=v0)
    th, x = jnp.array(list(NUMBERS.values())), jnp.array(run.x[0])
    by = jax.jacfwd(lambda th: jax.grad(lagrangian, argnums=1)(x[:2], jnp.array(v0), th))(th)
    dx = jnp.vstack([jnp.zeros((2, len(names))), by])
    for k in range(20):
        x, dx = advanced(jnp.array(run.q[k + 1]), x, dx, th)
        np.testing.assert_allclose(run.x[k + 1], x, atol=1e-12)
        np.testing.assert_allclose(found.x[k + 1], dx, atol=1e-11)


def test_errors() -> None:
    c = case("forces")
    m = c.mechanism
    vi = MidpointVI(m, threads=1)
    run = c.step(m, "symmetric")
    with pytest.raises(ArgumentError, match=r"'damping\.xx'; did you mean 'damping\.x'"):
        vi.differentiate_by(run, ["damping.xx"])
    with pytest.raises(ArgumentError, match=r"got the string 'damping\.x'"):
        vi.sensitivity(run, "damping.x")
    with pytest.raises(ArgumentError, match=r"'damping\.x' is listed twice"):
        vi.sensitivity(run, ["damping.x", "damping.a", "damping.x"])
    with pytest.raises(ArgumentError, match="both v and dx0"):
        vi.sensitivity(run, ["damping.x"], v=c.v, dx0=np.zeros((m.nx, 1)))
    with pytest.raises(ArgumentError, match=r"dx0: got shape .*, expected \(.*, 2\)"):
        vi.sensitivity(run, ["damping.x", "damping.a"], dx0=np.zeros((m.nx, 1)))
    with pytest.raises(ArgumentError, match="v: got shape"):
        vi.sensitivity(run, ["damping.x"], v=[1.0])
    with pytest.raises(ArgumentError, match="other names"):
        vi.differentiate_by(case("springs").step(case("springs").mechanism, "symmetric"), ["x"])
    with pytest.raises(StepError, match="does not lead to the next state"):
        vi.like(m.with_parameters({"tendon.gain": 20.0})).sensitivity(run, ["damping.x"])
    for _, parameter in REFUSED:
        with pytest.raises(ArgumentError, match="the weight that 'some' gives to 'hand' alone"):
            vi.differentiate_by(run, [parameter])


def test_nothing_asked_for() -> None:
    c = case("loops")
    d = MidpointVI(c.mechanism).sensitivity(c.step(c.mechanism, "symmetric"), [], v=c.v)
    assert d.names == ()
    assert d.x.shape == (2, c.mechanism.nx, 0)


def test_an_element_called_like_a_frame_has_the_name_of_what_both_have() -> None:
    m = Mechanism(
        [
            la.rx({"a": 1.0}, offset=-1.0, name="g", mass=0.2, inertia=(0.2, 0.2, 0.2)),
            la.rx("b", mass=1.0, inertia=(1.0, 1.0, 1.0)),
        ],
        [la.Coupling({"a": -0.2, "b": 1.0}, offset=-0.5, name="g")],
    )
    assert m.parameters["g.offset"] == -0.5
    assert m.with_parameters({"g.offset": 0.3}).elements["g"].offset == 0.3
