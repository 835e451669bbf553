"""Functions of time: sampling, evaluation, jumps; and the integrators that make them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.piecewise import Mesh, approximate
from leastaction.optimal.continuous import Accuracy, DenseTrajectory, PiecewisePolynomial
from leastaction.optimal.continuous.integrate import integrate


def _wave(t):
    return np.stack([np.sin(5 * t), np.exp(-t), t**3], axis=1)


def test_a_function_is_sampled_as_finely_as_it_needs():
    errors, pieces = [], []
    t = np.linspace(0, 4, 501)
    for tolerance in (1e-4, 1e-8, 1e-12):
        mesh, values = approximate(_wave, Mesh(np.array([0.0, 4.0])), tolerance)
        curve = mesh.fit(values, (3,))
        errors.append(np.abs(curve(t) - _wave(t)).max() / 64.0)
        pieces.append(len(mesh.breaks) - 1)
    assert pieces[0] < pieces[1] < pieces[2]
    for error, tolerance in zip(errors, (1e-4, 1e-8, 1e-12), strict=True):
        assert error < tolerance
    # Only where it is needed: a bump in a long calm.
    bump = lambda t: np.exp(-((t - 9.0) ** 2) / 0.01)[:, None]  # noqa: E731
    mesh, _ = approximate(bump, Mesh(np.linspace(0.0, 10.0, 21)), 1e-8)
    inside = np.diff(mesh.breaks)[np.abs(mesh.breaks[:-1] - 9.0) < 0.3]
    assert inside.max() < 0.2 < np.diff(mesh.breaks).max()


def test_noise_is_not_resolved():
    noise = np.random.default_rng(0)
    small = lambda t: 1e-9 * noise.standard_normal((len(t), 1))  # noqa: E731
    start = Mesh(np.linspace(0.0, 1.0, 5))
    mesh, _ = approximate(small, start, 1e-7, np.array([1.0]))
    assert mesh is start
    mesh, _ = approximate(small, start, 1e-7)
    assert 1000 < len(mesh.breaks) <= 20_000


def test_values_one_by_one_and_together():
    rng = np.random.default_rng(0)
    breaks = np.array([0.0, 0.5, 2.0, 2.1])
    curve = PiecewisePolynomial(breaks, rng.standard_normal((3, 8, 6)), (2, 3))
    for t in (rng.uniform(0.0, 2.1, 7), np.linspace(0.0, 2.1, 101)):
        together = curve(t)
        assert together.shape == (len(t), 2, 3)
        np.testing.assert_allclose(together, [curve(float(s)) for s in t], atol=1e-13)
    np.testing.assert_array_equal(curve([[0.1, 0.2]]).shape, (1, 2, 2, 3))
    np.testing.assert_allclose(curve.part([4, 0], (2,))(1.3), curve(1.3).ravel()[[4, 0]])
    h = 1e-6
    slope = (curve(1.3 + h) - curve(1.3 - h)) / (2 * h)
    np.testing.assert_allclose(curve.derivative()(1.3), slope, rtol=1e-7, atol=1e-6)


def test_weights_integrate():
    mesh = Mesh(np.array([0.0, 0.3, 1.0, 3.0]))
    assert mesh.weights @ mesh.t**7 == pytest.approx(3.0**8 / 8.0, rel=1e-13)


def test_through_samples():
    t = np.array([0.0, 1.0, 1.5, 4.0, 5.0])
    y = np.array([[0.0, 1.0], [1.0, 0.0], [3.0, 2.0], [-1.0, 2.0], [0.0, 0.0]])
    times = np.linspace(0.0, 5.0, 77)
    cubic = PiecewisePolynomial.through(t, y)
    np.testing.assert_allclose(cubic(times), CubicSpline(t, y)(times), atol=1e-13)
    linear = PiecewisePolynomial.through(t, y, kind="linear")
    expected = np.stack([np.interp(times, t, column) for column in y.T], axis=1)
    np.testing.assert_allclose(linear(times), expected, atol=1e-14)
    hold = PiecewisePolynomial.through(t, y[:-1], kind="hold")
    np.testing.assert_array_equal(hold([0.0, 0.99, 1.0, 4.5, 5.0]), y[[0, 0, 1, 3, 3]])
    # A value that stays is no jump.
    assert cubic.jumps() == ()
    assert linear.jumps() == (1.0, 1.5, 4.0)
    assert hold.jumps() == (1.0, 1.5, 4.0)
    assert PiecewisePolynomial.through(t, [[1.0], [1.0], [2.0], [2.0]], kind="hold").jumps() == (1.5,)
    assert (cubic.t0, cubic.tf) == (0.0, 5.0)


@pytest.mark.parametrize("solver", ["DOP853", "RK45", "Radau", "BDF", "LSODA"])
@pytest.mark.parametrize("backwards", [False, True])
def test_integrators(solver, backwards):
    """A pushed oscillator whose push jumps, against its closed form."""

    def fun(t, y):
        return np.array([y[1], (1.0 if t > 1.0 else 0.0) - y[0]])

    def exact(t):
        late = np.where(t > 1.0, 1.0 - np.cos(t - 1.0), 0.0), np.where(t > 1.0, np.sin(t - 1.0), 0)
        return np.stack([np.cos(t) + late[0], -np.sin(t) + late[1]], axis=1)

    ends = (3.0, 0.0) if backwards else (0.0, 3.0)
    start = exact(np.array([ends[0]]))[0]
    rtol = {"DOP853": 1e-10, "RK45": 1e-9}.get(solver, 1e-7)
    accuracy = Accuracy(solver=solver, rtol=rtol, atol=rtol / 100)
    done = integrate(fun, *ends, start, accuracy=accuracy, jumps=(1.0,))
    assert done.failure is None
    assert done.t == ends[1]
    assert 1.0 in done.breaks
    t = np.linspace(0, 3, 301)
    curve = done.curve((2,))
    np.testing.assert_allclose(curve(t), exact(t), atol=300 * rtol)
    np.testing.assert_allclose(done.y, exact(np.array([ends[1]]))[0], atol=300 * rtol)
    smooth = integrate(fun, *ends, start, accuracy=accuracy)
    assert done.steps < smooth.steps


def test_integrations_that_fail_say_when_and_why():
    def wall(t, y):
        if y[0] > 1.5:
            raise StepError("too far", t=t, residuals={}, iteration=0)
        return np.array([1.0])

    done = integrate(wall, 0.0, 3.0, np.zeros(1), accuracy=Accuracy())
    assert "too far" in done.failure
    assert done.t == pytest.approx(1.5, abs=1e-6)
    assert done.y[0] == pytest.approx(done.t)
    escaping = integrate(lambda t, y: y * y, 0.0, 3.0, np.ones(1), accuracy=Accuracy(), check=None)
    assert escaping.failure is not None
    assert escaping.t == pytest.approx(1.0, abs=1e-3)
    few = integrate(lambda t, y: y, 0.0, 3.0, np.ones(1), accuracy=Accuracy(max_steps=2))
    assert "max_steps" in few.failure
    with pytest.raises(ArgumentError, match="mine"):
        integrate(
            lambda t, y: (_ for _ in ()).throw(ArgumentError("mine")),
            0.0,
            1.0,
            np.zeros(1),
            accuracy=Accuracy(),
        )


def test_trajectories_of_samples_and_of_functions():
    t = np.linspace(0.0, 2.0, 41)
    x, u = np.stack([np.sin(t), np.cos(t)], axis=1), np.cos(3 * t)[:, None]
    sampled = DenseTrajectory.from_samples(t, x, u)
    given = DenseTrajectory.from_functions(
        lambda s: [np.sin(s), np.cos(s)], lambda s: [np.cos(3 * s)], horizon=(0, 2), nx=2, nu=1
    )
    times = np.linspace(0.0, 2.0, 97)
    np.testing.assert_allclose(given.sample(times)[0][:, 0], np.sin(times), atol=1e-9)
    np.testing.assert_allclose(given.u(times)[:, 0], np.cos(3 * times), atol=1e-9)
    np.testing.assert_allclose(sampled.x(times), given.x(times), atol=1e-6)
    held = DenseTrajectory.from_samples(t, x, u[:-1], kind="hold")
    np.testing.assert_allclose(held.u(0.024), u[0])
    assert (held.nx, held.nu, held.t0, held.tf) == (2, 1, 0.0, 2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PiecewisePolynomial.through([0.0, 0.0], [1.0, 2.0]), "t: times must increase"),
        (lambda: PiecewisePolynomial.through([0.0, 1.0], [1.0]), r"values: got shape \(1,\)"),
        (lambda: PiecewisePolynomial.through([0.0, 1.0], [1.0, np.nan]), "values: got nan"),
        (lambda: PiecewisePolynomial.through([0.0, 1.0], [1.0, 2.0], kind="wild"), "kind: got"),
        (lambda: Accuracy(solver="Euler"), "solver: got 'Euler'"),
        (lambda: Accuracy(rtol=0.0), "rtol: got 0.0"),
        (lambda: Accuracy(atol=-1.0), "atol: got -1.0"),
        (lambda: Accuracy(max_steps=0), "max_steps: got 0"),
        (
            lambda: DenseTrajectory.from_samples([0.0, 1.0], np.zeros((2, 2, 2)), np.zeros((2, 1))),
            "x, u: got samples of shapes",
        ),
        (
            lambda: DenseTrajectory.from_functions(lambda t: [t], [0.0], horizon=(0, 1), nx=2, nu=1),
            r"x at t = 0 s: got shape \(1,\)",
        ),
        (
            lambda: DenseTrajectory.from_samples([0.0, 1.0], np.zeros((2, 1)), np.zeros((2, 1))).sample([1.5]),
            "t: got times from 1.5",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ArgumentError, match=message):
        make()
