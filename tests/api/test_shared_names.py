"""Frames, variables and elements may share a name; no two parameters may."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import mechanics as la
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import Body, Mechanism, rz, ty, tz


def arm(name="bob"):
    return [rz("mass"), [ty(-1.0, name=name, mass=1.0)]]


@pytest.mark.parametrize(
    "element",
    [
        la.Gravity(name="bob"),
        la.JointSpring("mass", 2.0, name="bob"),
        la.NonlinearDamping("mass", (0.1, 0.2), name="bob"),
        la.BodyWrench("bob", force=(1.0, 0.0, 0.0), name="bob"),
        la.Drag("bob", 0.5, name="bob"),
    ],
)
def test_a_body_keeps_its_parameters_beside_an_element_of_the_same_name(element):
    mechanism = Mechanism(arm(), [element])
    changed = mechanism.with_parameters({"bob.mass": 2.5})
    assert changed.mass == 2.5
    assert changed.elements == mechanism.elements


def test_the_parameters_of_elements_go_to_the_element_that_has_them():
    # Of the two elements whose names a parameter begins with, the longer name does not have it.
    pull = la.Gravity((0.0, -9.81, 0.0), frames=["fc.c1"], name="g")
    oil = la.NonlinearDamping("mass", (0.3,), name="g.mass.fc")
    mechanism = Mechanism(arm("fc.c1"), [pull])
    assert mechanism.with_parameters({"g.mass.fc.c1": 3.0}).parameters["g.mass.fc.c1"] == 3.0
    with pytest.raises(DescriptionError, match=r"'g.mass.fc': its par.*'g.mass.fc.c1'|'g.mass.fc.c1'.*'g'"):
        Mechanism(arm("fc.c1"), [pull, oil])


def test_a_parameter_with_two_meanings_is_refused():
    with pytest.raises(DescriptionError, match=r"'bob.mass'.*frame 'bob'.*another name"):
        Mechanism(arm(), [la.Damping({"mass": 0.1}, name="bob")])
    tree = [
        rz("a"),
        [ty(-1.0, name="bob", bodies=[Body(1.0), Body(2.0)]), tz(1.0, name="bob.body2", mass=1.0)],
    ]
    with pytest.raises(DescriptionError, match=r"'bob.body2'.*like body 2 of the frame 'bob'"):
        Mechanism(tree)


@pytest.mark.parametrize("values", [3, None, "bob.mass", ["bob.mass"]])
def test_new_values_are_a_mapping(values):
    with pytest.raises(ArgumentError, match="mapping of names to values"):
        Mechanism(arm()).with_parameters(values)


def test_new_values_leave_no_variable_without_inertia():
    mechanism = Mechanism([rz("a", name="wheel", mass=1.0, com=(0.5, 0.0, 0.0))])
    with pytest.raises(DescriptionError, match=r"massless dynamic variable 'a'.*axis"):
        mechanism.with_parameters({"wheel.com.x": 0.0})
    with pytest.raises(DescriptionError, match=r"inertia that the variable 'a'.*(inf|nan).*too large"):
        mechanism.with_parameters({"wheel.com.x": 1e300})
    assert mechanism.with_parameters({"wheel.com.x": 1e-6}).mass_matrix([0.0])[0, 0] == 1e-12


def test_gravity_on_some_masses_goes_with_one_on_all_in_any_order():
    some, every = la.Gravity((1.0, 0.0, 0.0), frames=["bob"]), la.Gravity((0.0, -9.81, 0.0))
    one, other = (Mechanism(arm(), pair) for pair in ([some, every], [every, some]))
    gradients = [m.core.gradient(np.array([0.3]), np.zeros(1))[0] for m in (one, other)]
    np.testing.assert_allclose(*gradients, rtol=1e-15)
    with pytest.raises(DescriptionError, match="only one Gravity"):
        Mechanism(arm(), [every, some, la.Gravity()])


def test_the_tension_of_a_string_that_is_called_like_its_length():
    """`linear` strings are told by their lengths, so both names are often the same."""
    m = Mechanism(
        [rz("a"), [ty(-1.0, name="bob", mass=1.0)], tz(0.0, name="hook")],
        [la.Gravity((0.0, -9.8, 0.0)), la.PathLength(["hook", "bob"], "string", name="string")],
    )
    assert "string" in m.variables
    assert "string" in m.constraints
    vi = la.MidpointVI(m)
    start = vi.start(m.configuration({"a": 0.0, "string": 1.0}))
    run = vi.simulate(start, 0.01 * np.arange(4))
    (pull,) = run.tensions().values()
    assert pull.shape == (3,)
    other = Mechanism(
        [rz("a"), [ty(-1.0, name="bob", mass=1.0)], tz(0.0, name="hook")],
        [la.Gravity((0.0, -9.8, 0.0)), la.PathLength(["hook", "bob"], "length", name="string")],
    )
    vi = la.MidpointVI(other)
    same = vi.simulate(vi.start(start.q), 0.01 * np.arange(4)).tensions()["string"]
    np.testing.assert_array_equal(pull, same)
