"""Smooth curves: through their points, smooth, carried on, integrated."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import Curve

X = np.array([0.0, 0.3, 0.5, 1.1, 1.4, 2.0, 2.2, 3.0])


def test_it_is_the_quintic_spline_through_its_points():
    curve, spline = Curve(X, np.sin(X)), make_interp_spline(X, np.sin(X), k=5)
    places = np.linspace(0.0, 3.0, 101)
    np.testing.assert_allclose(curve(X), np.sin(X), atol=1e-14)
    np.testing.assert_allclose(curve(places), spline(places), atol=1e-13)
    np.testing.assert_allclose(curve(places, 2), spline(places, 2), atol=1e-12)
    assert curve.coefficients.shape == (len(curve.breaks) - 1, 6)
    assert (curve.start, curve.end) == (0.0, 3.0)


def test_pieces_are_in_ascending_powers_from_their_break():
    curve = Curve(X, np.cos(X))
    i, x = 1, 0.5 * (curve.breaks[1] + curve.breaks[2])
    powers = (x - curve.breaks[i]) ** np.arange(6)
    assert curve.coefficients[i] @ powers == pytest.approx(curve(x), rel=1e-13)


def test_four_derivatives_are_continuous():
    curve = Curve(X, np.sin(3.0 * X))
    inner = curve.breaks[1:-1]
    assert len(inner) > 0
    for order in range(5):
        left, right = (curve(np.nextafter(inner, side), order) for side in (-1.0, 9.0))
        np.testing.assert_allclose(left, right, rtol=1e-6, atol=1e-6 * np.abs(right).max())
    left, right = (curve(np.nextafter(inner, side), 5) for side in (-1.0, 9.0))
    assert np.abs(left - right).max() > 1.0, "the fifth jumps, or nothing was tested"


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_few_points_are_met_by_one_polynomial(n):
    curve = Curve(X[:n], X[:n] ** 2 - X[:n])
    assert curve.coefficients.shape == (1, n)
    np.testing.assert_allclose(curve(X[:n]), X[:n] ** 2 - X[:n], atol=1e-13)
    if n > 2:
        assert curve(5.0) == pytest.approx(20.0, rel=1e-8)


def test_the_end_pieces_carry_on():
    curve = Curve(X, X**5 - X)
    for x in (-1.0, 4.0):
        assert curve(x) == pytest.approx(x**5 - x, rel=1e-7)


def test_the_integral_starts_at_zero_and_is_undone_by_the_derivative():
    curve = Curve(X, np.exp(X))
    energy = curve.integral()
    assert energy(0.0) == 0.0
    assert energy(3.0) == pytest.approx(np.exp(3.0) - 1.0, rel=1e-4)
    places = np.linspace(-0.5, 3.5, 50)
    np.testing.assert_allclose(energy(places, 1), curve(places), rtol=1e-12)


def test_from_a_function():
    curve = Curve.from_function(np.tanh, -2.0, 2.0, pieces=40)
    places = np.linspace(-2.0, 2.0, 333)
    np.testing.assert_allclose(curve(places), np.tanh(places), atol=1e-6)
    assert (curve.start, curve.end) == (-2.0, 2.0)


def test_a_curve_is_a_value():
    curve = Curve(X, np.sin(X))
    again = pickle.loads(pickle.dumps(curve))
    assert again == curve
    assert hash(again) == hash(curve)
    assert again(0.7) == curve(0.7)
    assert curve != Curve(X, np.cos(X))
    assert curve != 3
    assert repr(curve) == "<Curve from 0 to 3: 3 pieces of degree 5>"
    assert isinstance(curve(1.0), float)
    assert curve([[0.0, 1.0]]).shape == (1, 2)
    with pytest.raises(AttributeError, match="immutable"):
        curve.breaks = X
    with pytest.raises(ValueError, match="read-only"):
        curve.coefficients[0, 0] = 1.0


BAD = {
    "one point": (lambda: Curve([1.0], [1.0]), "1 point;.*two"),
    "none": (lambda: Curve([], []), "0 points;.*two"),
    "back": (lambda: Curve([0, 2, 1], [0, 0, 0]), r"x\[1\] = 2 is followed by x\[2\] = 1"),
    "twice": (lambda: Curve([0, 1, 1], [0, 0, 0]), "strictly"),
    "nan": (lambda: Curve([0, float("nan")], [0, 1]), "Curve: x.*nan"),
    "lengths": (lambda: Curve([0, 1, 2], [0, 1]), r"Curve: y.*\(2,\).*\(3,\)"),
    "text": (lambda: Curve("ab", [1, 2]), "Curve: x.*'ab'"),
    "range": (lambda: Curve.from_function(abs, 1, 1), "start 1 and end 1"),
    "pieces": (lambda: Curve.from_function(abs, 0, 1, pieces=0), "pieces: got 0"),
    "half a piece": (lambda: Curve.from_function(abs, 0, 1, pieces=2.5), "pieces.*2.5"),
    "pole": (lambda: Curve.from_function(lambda x: np.inf, 0, 1), "function at 0.*inf"),
    "no number": (lambda: Curve.from_function(lambda x: None, 0, 1), "function at 0.*None"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_curve(case):
    make, pattern = BAD[case]
    with pytest.raises(DescriptionError, match=f"(?s){pattern}"):
        make()


@pytest.mark.parametrize(("order", "pattern"), [(-1, "integral.*-1"), (1.5, "1.5.*whole")])
def test_bad_derivative(order, pattern):
    with pytest.raises(ArgumentError, match=pattern):
        Curve([0, 1], [0, 1])(0.5, order)
