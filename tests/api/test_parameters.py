"""Named parameters: what they are called, what they are, and mechanisms with other numbers."""

from __future__ import annotations

import copy
import pickle
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from leastaction import mechanics as la
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import Body, Mechanism, MidpointVI, pose, rx, ry, rz, tx, ty, tz
from leastaction.mechanics import expressions as ex
from leastaction.models.marionette import marionette

NUMBERS: dict[str, float] = {
    "cart.mass": 3.0,
    "rod.value": -0.6,
    "tilt.value": 0.2,
    "hook.translation.x": 0.4,
    "hook.translation.z": 0.9,
    "bob.mass": 0.7,
    "bob.com.x": 0.1,
    "bob.inertia.xx": 0.03,
    "bob.inertia.xy": 0.004,
    "bob.body2.mass": 0.2,
    "string.length": 1.4,
    "gear.offset": 0.1,
    "gear.factors.b": -0.6,
    "spring.stiffness": 5.0,
    "spring.length": 0.3,
    "curve.scale": 1.0,
    "damping.x": 0.3,
    "damping.b": 0.05,
    "cubic.c3": 0.2,
    "air.wind.y": -0.5,
    "push.fx": 0.4,
    "tendon.gain": 2.0,
    "magnet.strength": 0.2,
}

OTHER: dict[str, float] = {
    "cart.mass": 2.2,
    "rod.value": -0.75,
    "tilt.value": -0.1,
    "hook.translation.x": 0.1,
    "hook.translation.z": 1.1,
    "bob.mass": 1.1,
    "bob.com.x": -0.05,
    "bob.inertia.xx": 0.04,
    "bob.inertia.xy": -0.003,
    "bob.body2.mass": 0.5,
    "string.length": 1.2,
    "gear.offset": -0.2,
    "gear.factors.b": 0.8,
    "spring.stiffness": 7.0,
    "spring.length": 0.5,
    "curve.scale": 1.0,
    "damping.x": 0.0,
    "damping.b": 0.4,
    "cubic.c3": 0.6,
    "air.wind.y": 1.5,
    "push.fx": -0.8,
    "tendon.gain": -1.0,
    "magnet.strength": 0.6,
}


def machine(n: Mapping[str, float] = NUMBERS) -> Mechanism:
    """Return a machine with every kind of parameter, described with these numbers."""
    curve = la.Curve([-2.0, 2.0], [-3.0, 3.0])
    gap = ex.distance("bob", "hook")
    inertia = (n["bob.inertia.xx"], 0.04, 0.05, n["bob.inertia.xy"], 0.0, 0.0)
    bob = [
        Body(n["bob.mass"], com=(n["bob.com.x"], 0.0, 0.0), inertia=inertia),
        Body(n["bob.body2.mass"], com=(0.0, 0.1, 0.0)),
    ]
    hook = (n["hook.translation.x"], 0.0, n["hook.translation.z"])
    return Mechanism(
        [
            pose(translation=hook, name="hook"),
            rx(n["tilt.value"], name="tilt"), [
                tx("x", name="cart", mass=n["cart.mass"]), [
                    rz("a"), [ty(n["rod.value"], name="rod"), [ry("b", name="bob", bodies=bob)]],
                    tz("c"), [tz(0.1, mass=0.5)],
                ],
            ],
        ],
        [
            la.Gravity((0.0, -9.8, 0.0)),
            la.Distance("bob", "hook", n["string.length"], name="string"),
            la.Coupling({"c": 1.0, "b": n["gear.factors.b"]}, offset=n["gear.offset"], name="gear"),
            la.LinearSpring("cart", "hook", n["spring.stiffness"], length=n["spring.length"], name="spring"),
            la.NonlinearSpring("a", curve, name="curve"),
            la.Damping({"x": n["damping.x"], "b": n["damping.b"]}),
            la.NonlinearDamping("a", (0.1, n["cubic.c3"]), name="cubic"),
            la.Drag("bob", 0.2, wind=(0.0, n["air.wind.y"], 0.0), name="air"),
            la.HybridWrench("bob", (n["push.fx"], 0.0, "thrust"), (0.0, 0.1, 0.0), name="push"),
            la.TendonForce(["hook", "bob"], "pull", n["tendon.gain"], name="tendon"),
            la.ExpressionPotential(ex.parameter("strength", n["magnet.strength"]) / gap, name="magnet"),
        ],
        dynamic=["b", "x", "c", "a"],
        inputs=["pull", "thrust"],
    )  # fmt: skip


def rolled(m: Mechanism) -> np.ndarray:
    """Return a few steps from a start on the constraints."""
    q = la.project_configuration(m, [0.3, 0.2, 0.4, 0.5]).q
    vi = MidpointVI(m)
    v = la.project_velocity(m, q, [0.5, -1.0, 0.2, 0.3]).v
    run = vi.simulate(vi.start(q, v), np.linspace(0.0, 0.2, 11), inputs=[1.5, 0.7])
    assert run.steps == 10, run.message
    return np.hstack([run.x[1:], run.lam])


def pendulum() -> Mechanism:
    return Mechanism([rx("a"), [ty(-1.0, name="bob", mass=1.0)]], [la.Gravity((0.0, -9.8, 0.0))])


# What is changed


def test_names_and_values() -> None:
    parameters = machine().parameters
    assert {name: parameters[name] for name in NUMBERS} == NUMBERS
    assert {n for n in parameters if n.startswith("cart.")} == {
        *("cart.mass", "cart.com.x", "cart.com.y", "cart.com.z", "cart.inertia.xx"),
        *("cart.inertia.yy", "cart.inertia.zz", "cart.inertia.xy", "cart.inertia.xz"),
        "cart.inertia.yz",
    }
    # Frames that move have no length, and inputs no number; frames without a name have one that was made.
    assert not {"a.value", "rz(a).value", "push.fz", "gravity.x"} & set(parameters)
    assert parameters["tz(c)/tz(0.1).value"] == 0.1
    assert parameters["tz(c)/tz(0.1).mass"] == 0.5
    assert all(isinstance(value, float) for value in parameters.values())


def test_other_numbers_are_another_description() -> None:
    """To change numbers is to describe the mechanism with them, to the last digits of its motion."""
    described, changed = machine(OTHER), machine().with_parameters(OTHER)
    assert changed.parameters == described.parameters
    np.testing.assert_allclose(rolled(changed), rolled(described), rtol=1e-12, atol=1e-12)
    assert np.abs(rolled(changed) - rolled(machine())).max() > 0.1


@pytest.mark.parametrize("name", NUMBERS)
def test_each_number_alone(name: str) -> None:
    m = machine()
    if name == "curve.scale":
        # A number that no argument sets: it scales the curve of the force.
        changed = m.with_parameters({name: 2.0})
        q = np.array([0.3, 0.2, 0.4, 0.5])
        energy = changed.energy(q, 0.0 * q).potential - m.energy(q, 0.0 * q).potential
        # The integral of 1.5 s from the curve's start.
        assert energy == pytest.approx(0.75 * (0.5**2 - 2.0**2), rel=1e-13)
        return
    changed = m.with_parameters({name: OTHER[name]})
    described = machine({**NUMBERS, name: OTHER[name]})
    assert changed.parameters == described.parameters == {**m.parameters, name: OTHER[name]}
    np.testing.assert_allclose(rolled(changed), rolled(described), rtol=1e-12, atol=1e-12)


def test_the_names_and_their_order_stay() -> None:
    m = machine()
    changed = m.with_parameters({**OTHER, "tz(c)/tz(0.1).value": 0.7})
    for names in ("frames", "variables", "dynamic", "kinematic", "inputs", "constraints"):
        assert getattr(changed, names) == getattr(m, names), names
    assert list(changed.parameters) == list(m.parameters)
    assert list(changed.elements) == list(m.elements)
    assert changed.parameters["tz(c)/tz(0.1).value"] == 0.7


def test_there_and_back() -> None:
    m = machine()
    back = m.with_parameters(OTHER).with_parameters(NUMBERS)
    assert back.parameters == m.parameters
    np.testing.assert_array_equal(rolled(back), rolled(m))
    np.testing.assert_array_equal(rolled(m.with_parameters(m.parameters)), rolled(m))
    np.testing.assert_array_equal(rolled(m.with_parameters({})), rolled(m))
    fields = set(NUMBERS) - {"curve.scale", "magnet.strength"}
    changed = m.with_parameters({name: OTHER[name] for name in fields})
    assert str(changed.with_parameters({name: NUMBERS[name] for name in fields})) == str(m)


def test_the_old_mechanism_stays() -> None:
    m = machine()
    before, text, motion = m.parameters, str(m), rolled(m)
    m.with_parameters(OTHER)
    assert m.parameters == before
    assert str(m) == text
    np.testing.assert_array_equal(rolled(m), motion)
    # What is returned is a copy.
    m.parameters["cart.mass"] = 7.0
    assert m.parameters == before
    # And what an error left behind is nothing.
    with pytest.raises(DescriptionError):
        m.with_parameters({"cart.mass": 5.0, "string.length": -1.0})
    assert m.parameters == before


def test_it_is_printed_with_its_numbers() -> None:
    m = machine()
    changed = m.with_parameters({"cart.mass": 8.5, "string.length": 1.25, "rod.value": -0.875})
    for part in ("8.5 kg", "bob to hook, 1.25 m", "ty(-0.875)"):
        assert part in str(changed)
        assert part in changed._repr_html_()
        assert part not in str(m)
    assert changed.elements["string"].length == 1.25  # type: ignore[attr-defined]
    assert changed.mass == pytest.approx(m.mass + 5.5)
    # A frame that has no name but its transformation, and numbers that no field of an element holds.
    changed = m.with_parameters({"tz(c)/tz(0.1).value": 0.7, "curve.scale": 2.5, "magnet.strength": 0.45})
    for part in ("tz(0.7)", "curve.scale", "magnet.strength", "2.5", "0.45"):
        assert part in str(changed)
        assert part in changed._repr_html_()
        assert part not in str(m)


def test_copies() -> None:
    changed = machine().with_parameters(OTHER).with_parameters({"curve.scale": 1.5})
    for other in (pickle.loads(pickle.dumps(changed)), copy.deepcopy(changed), copy.copy(changed)):
        assert other.parameters == changed.parameters
        assert str(other) == str(changed)
        np.testing.assert_array_equal(rolled(other), rolled(changed))


def test_more_elements() -> None:
    """Elements that are added to a mechanism with other numbers leave these as they are."""
    changed = machine().with_parameters({**OTHER, "curve.scale": 1.5})
    more = changed.with_elements([la.JointSpring("x", 3.0, name="extra")])
    assert more.parameters == {**changed.parameters, "extra.stiffness": 3.0, "extra.rest": 0.0}


def test_numbers_that_must_change_together() -> None:
    """An inertia that is that of no body on the way to one that is."""
    m = pendulum()
    changed = m.with_parameters({f"bob.inertia.{i}{i}": 1.0 for i in "xyz"})
    assert changed.parameters["bob.inertia.yy"] == 1.0
    back = changed.with_parameters({f"bob.inertia.{i}{i}": 0.0 for i in "xyz"})
    assert back.parameters == m.parameters


def test_a_frame_and_an_element_of_one_name() -> None:
    """Their parameters are told apart by what follows the name."""
    m = Mechanism(
        [rx("a"), [ty(-1.0, name="bob", mass=1.0)], tz(1.0, name="spring")],
        [
            la.Damping({"a": 0.5}, name="bob"),
            la.LinearSpring("bob", "spring", 3.0, length=0.5, name="spring"),
        ],
    )
    new = {"bob.mass": 2.0, "bob.a": 0.25, "spring.value": 1.5, "spring.stiffness": 4.0}
    changed = m.with_parameters(new)
    assert changed.parameters == {**m.parameters, **new}
    assert changed.elements["bob"].named == {"a": 0.25}  # type: ignore[attr-defined]


def test_two_parameters_of_one_name() -> None:
    heavy = ex.parameter("mass", 2.0) * ex.point("bob")[2]
    with pytest.raises(DescriptionError, match=r"'bob\.mass'.*the frame 'bob'.*another name"):
        Mechanism(
            [rx("a"), [ty(-1.0, name="bob", mass=1.0)]],
            [la.ExpressionPotential(heavy, name="bob")],
        )


# What is refused


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        (
            {"bob.mas": 1.0},
            ArgumentError,
            r"unknown parameter 'bob\.mas'; did you mean 'bob\.mass'",
        ),
        ({"sprng.stiffness": 1.0}, ArgumentError, r"did you mean 'spring\.stiffness'"),
        ({"x": 1.0}, ArgumentError, "unknown parameter 'x'"),
        ({1: 2.0}, ArgumentError, "unknown parameter 1"),
        ({"bob.mass": np.nan}, ArgumentError, r"'bob\.mass': got nan, expected a finite number"),
        ({"rod.value": np.inf}, ArgumentError, r"'rod\.value': got inf"),
        ({"bob.mass": "2"}, ArgumentError, r"'bob\.mass': got '2' .*, expected a number"),
        ({"bob.mass": True}, ArgumentError, "got True .*, expected a number"),
        ({"bob.mass": None}, ArgumentError, "got None .*, expected a number"),
        ({"bob.mass": [1.0, 2.0]}, ArgumentError, "expected a number"),
        (["bob.mass"], ArgumentError, "expected a mapping of names to values"),
        ("bob.mass", ArgumentError, "expected a mapping of names to values"),
        (None, ArgumentError, "expected a mapping of names to values"),
        ({"bob.mass": -1.0}, DescriptionError, r"frame 'bob': mass: got -1"),
        ({"bob.inertia.xx": -1.0}, DescriptionError, r"frame 'bob': inertia: .*negative"),
        ({"bob.inertia.xx": 1.0}, DescriptionError, r"frame 'bob': inertia: .*no real body"),
        ({"string.length": -1.0}, DescriptionError, "'string': length: got -1 m"),
        ({"string.length": 0.0}, DescriptionError, "'string': length: got 0 m"),
        ({"spring.stiffness": 0.0}, DescriptionError, "'spring': stiffness: got 0"),
        ({"spring.length": 0.0}, DescriptionError, "'spring'.*described with a length keeps one"),
        ({"gear.factors.b": 0.0}, DescriptionError, "'gear': factors: the factor of 'b' is zero"),
        (
            {"damping.x": -0.1},
            DescriptionError,
            "Damping: coefficients: the coefficient of x: got -0.1",
        ),
        ({"cubic.c3": -0.1}, DescriptionError, "'cubic': coefficients: c3: got -0.1"),
        ({"tendon.gain": 0.0}, DescriptionError, "'tendon': gain: got 0"),
        ({"air.coefficient": 0.0}, DescriptionError, "'air': coefficient: got 0"),
    ],
)
def test_errors(values: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        machine().with_parameters(values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"bob.mass": 0.0}, r"massless dynamic variable 'a'.*where nothing has a mass"),
        ({"bob.value": 0.0}, r"massless dynamic variable 'a'.*all lie on its axis"),
        ({"bob.com.y": 1.0}, r"massless dynamic variable 'a'.*all lie on its axis"),
        ({"bob.value": 1e200}, "too large to compute with"),
        ({"bob.mass": 1e308, "bob.value": -10.0}, "too large to compute with"),
    ],
)
def test_a_variable_that_is_left_without_a_mass(values: dict[str, float], message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        pendulum().with_parameters(values)


def test_a_frame_too_far_away() -> None:
    m = Mechanism([rx("a"), [ty(-1.0, name="arm"), [ty(-1.0, name="bob", mass=1.0)]]])
    with pytest.raises(DescriptionError, match="frame 'bob': its constant pose is too far"):
        m.with_parameters({"arm.value": 1.7e308, "bob.value": 1.7e308})


def test_it_is_cheaper_than_to_describe_again() -> None:
    """Nothing is analysed again."""
    m = marionette()
    name = next(name for name in m.parameters if name.endswith(".mass"))
    changed = {name: 1.1 * m.parameters[name]}
    best = [np.inf, np.inf]
    for _ in range(20):  # others on this machine can only lengthen a measurement
        for i, work in enumerate((lambda: m.with_parameters(changed), marionette)):
            begun = time.perf_counter()
            work()
            best[i] = min(best[i], time.perf_counter() - begun)
    assert 3.0 * best[0] < best[1]


def test_a_frame_without_a_name_has_parameters_by_its_variable() -> None:
    """And is still found by the name that was made for it."""
    m = Mechanism([tx("cart", mass=2.0), [rz("a", mass=1.0, com=(0, -1, 0)), [rz("a", mass=0.5)]]])
    assert {n: m.parameters[n] for n in ("cart.mass", "a.com.y", "rz(a)#2.mass")} == {
        "cart.mass": 2.0,
        "a.com.y": -1.0,
        "rz(a)#2.mass": 0.5,
    }
    assert "tx(cart).mass" not in m.parameters
    changed = m.with_parameters({"tx(cart).mass": 3.0, "a.mass": 4.0})
    assert changed.parameters["cart.mass"] == 3.0
    assert changed.mass == 7.5
    # A name that another frame was given is not taken away from it, nor is a coupled coordinate one variable.
    taken = Mechanism([tx("cart", mass=2.0), [rz(2.0 * la.var("a"), name="cart", mass=1.0, com=(1, 0, 0))]])
    assert taken.parameters["cart.mass"] == 1.0
    assert taken.parameters["tx(cart).mass"] == 2.0
    with pytest.raises(ArgumentError, match=r"'tx\(wagon\)\.mass'.*unknown|unknown.*wagon"):
        m.with_parameters({"tx(wagon).mass": 1.0})


def test_more_frames() -> None:
    """Frames that are added are as if they had been described, and what hangs on them has its names last."""
    m = Mechanism([ty("y", name="bob", mass=1.0)], [la.Gravity()])
    hook = [tz(2.0), [ty("cart", name="hook", kinematic=True)]]
    string = la.Distance("hook", "bob", "length", name="string")
    more = m.with_frames("world", hook).with_elements([string])
    assert more.kinematic == ("cart", "length")
    assert more == Mechanism([ty("y", name="bob", mass=1.0), *hook], [la.Gravity(), string])
    heavier = m.with_parameters({"bob.mass": 2.0}).with_frames("bob", [ty("z", name="load", mass=1.0)])
    assert heavier.dynamic == ("y", "z")
    assert heavier.parameters["bob.mass"] == 2.0
    with pytest.raises(ArgumentError, match="bib"):
        m.with_frames("bib", hook)
    with pytest.raises(DescriptionError, match="massless"):
        m.with_frames("bob", [ty("z")])
