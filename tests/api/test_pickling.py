"""Every public object can be pickled and deep-copied, across processes, and comes back as it was."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import joblib
import numpy as np
import pytest

import leastaction as la
from api.modules import public_names
from api.pickling_cases import (
    CASES,
    PLAIN,
    PUBLIC,
    Square,
    changed,
    cost,
    look,
    mechanism,
    parts,
    swing_down,
    system,
    writable,
)
from leastaction import _core


def check_same(given: Any, got: Any) -> None:
    """Compare all that two values are made of, bit by bit, and what can be written to in them."""
    expected, found = dict(parts(given)), dict(parts(got))
    assert list(expected) == list(found)
    for where, part in expected.items():
        other = found[where]
        assert type(other) is type(part), where
        if isinstance(part, np.ndarray):
            assert part.dtype == other.dtype, where
            np.testing.assert_array_equal(other, part, err_msg=where)
        elif isinstance(part, PLAIN):
            assert part == other or part != part, where
    assert writable(got) <= writable(given)
    for where, part in expected.items():
        if isinstance(part, la.Mechanism):
            check_behaviour(part, found[where])


def check_behaviour(given: la.Mechanism, got: la.Mechanism) -> None:
    """Compare what two mechanisms compute, bit by bit."""
    assert str(given) == str(got)
    assert given.parameters == got.parameters
    rng = np.random.default_rng(3)
    q, v = rng.normal(size=(2, given.nq))
    for first, second in zip(given.core.hessian(q, v), got.core.hessian(q, v), strict=True):
        np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(given.constraint_jacobian(q), got.constraint_jacobian(q))


def test_every_public_class_has_a_case():
    public = {name: it for name, it in public_names().items() if hasattr(la, name) and inspect.isclass(it)}
    assert set(public) == set(PUBLIC)
    for name, make in PUBLIC.items():
        assert isinstance(make(), public[name]), name


@pytest.mark.parametrize("name", CASES)
def test_a_pickle_brings_it_back(name):
    value = CASES[name]()
    for protocol in (2, pickle.HIGHEST_PROTOCOL):
        check_same(value, pickle.loads(pickle.dumps(value, protocol=protocol)))


@pytest.mark.parametrize("name", CASES)
def test_a_deep_copy_is_the_same(name):
    value = CASES[name]()
    check_same(value, copy.deepcopy(value))
    check_same(value, copy.copy(value))


@pytest.fixture(scope="module")
def workers() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        yield pool


def test_it_goes_to_another_process_and_back(workers):
    names = list(CASES)
    values = [CASES[name]() for name in names]
    for name, value, (back, there) in zip(names, values, workers.map(look, values, chunksize=8), strict=True):
        assert there <= writable(value), name
        check_same(value, back)


def test_frozen_arrays_stay_frozen():
    run = pickle.loads(pickle.dumps(CASES["Trajectory"]()))
    for array in (run.q, run.p, run.t, run.last.q):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    body = copy.deepcopy(CASES["Body"]())
    with pytest.raises(ValueError, match="read-only"):
        body.com[0] = 1.0
    with pytest.raises(TypeError):
        pickle.loads(pickle.dumps(CASES["OptimizationResult"]())).timings["total"] = 0.0


def test_a_mechanism_with_other_numbers_computes_the_same_after_the_trip():
    """Numbers that take a mass away change which joints carry one, and with that the order of sums."""
    full = mechanism()
    for values in ({"bob.mass": 0.0}, {"end.mass": 0.0, "bob.com.x": 0.1}, {"spring.length": 0.2}):
        there = full.with_parameters(values)
        check_same(there, pickle.loads(pickle.dumps(there)))
        back = there.with_parameters({name: full.parameters[name] for name in values})
        check_behaviour(full, back)
        check_same(back, pickle.loads(pickle.dumps(back)))


def test_a_mass_that_is_taken_from_a_prescribed_joint_is_no_trace_of_before():
    full = la.Mechanism(
        [la.tx("k", kinematic=True, mass=1.0), la.rz("a", mass=1.0, com=(1, 0, 0))],
        [la.Gravity((0.0, -9.81, 0.0))],
    )
    light = full.with_parameters({"k.mass": 0.0})
    described = la.Mechanism(
        [la.tx("k", kinematic=True, mass=0.0), la.rz("a", mass=1.0, com=(1, 0, 0))],
        [la.Gravity((0.0, -9.81, 0.0))],
    )
    for same in (described, pickle.loads(pickle.dumps(light))):
        check_behaviour(light, same)
        vi, start = la.MidpointVI(same), [0.3, 0.2]
        runs = [la.MidpointVI(light), vi]
        first, second = (r.simulate(r.start(start), 0.1 * np.arange(9)) for r in runs)
        np.testing.assert_array_equal(first.p, second.p)


def test_a_tree_under_construction_comes_back_at_its_place():
    root = la.world("base")
    arm = root.tx("x", name="cart")
    arm.rz("theta", name="arm")
    root.ty("y", name="other")
    place = pickle.loads(pickle.dumps(arm))
    assert place.frame.name == "cart"
    place.tx(1.0, name="tool", mass=1.0)
    assert [child.frame.name for child in place.children] == ["arm", "tool"]
    assert place.root.world_name == "base"
    assert [child.frame.name for child in place.root.children] == ["cart", "other"]


def test_fifty_starts_run_in_processes():
    problem, weights = system(), cost()
    jobs = [joblib.delayed(swing_down)(k, problem, weights) for k in range(50)]
    there: Any = joblib.Parallel(n_jobs=2)(jobs)
    assert len(there) == 50
    for k in (0, 17, 49):
        result, run = swing_down(k, problem, weights)
        np.testing.assert_array_equal(there[k][0].x, result.x)
        np.testing.assert_array_equal(there[k][1].q, run.q)
        assert there[k][0].status is result.status
        assert not there[k][1].q.flags.writeable


def test_a_function_of_the_user_travels_with_its_mechanism():
    spring = la.PythonPotential(Square(), variables=["x"], name="square")
    there = pickle.loads(pickle.dumps(mechanism().with_elements([spring])))
    q = there.configuration({"x": 3.0})
    assert there.energy(q, 0.0 * q).potential - mechanism().energy(q, 0.0 * q).potential == 9.0


def test_the_core_is_not_in_the_pickle():
    """What was compiled is compiled again where it arrives, so a pickle fits every variant of the core."""
    text = pickle.dumps(changed())
    for name in _core.__dict__:
        assert f"_core.{name}".encode() not in text


def test_a_long_chain_of_calls_is_no_deep_recursion():
    place = la.world()
    for i in range(3000):
        place = place.rz(f"q{i}").tx(1.0, mass=1.0)
    for there in (pickle.loads(pickle.dumps(place)), copy.deepcopy(place)):
        assert there.frame.label == "tx(1)"
        assert la.mechanics.description.branch.preorder(there.root)[1] == list(range(-1, 6000))
