"""Smooth curves: through their points, smooth, carried on, integrated."""

from __future__ import annotations

import contextlib
import itertools
import pickle
import re

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from leastaction.errors import ArgumentError, DescriptionError, SwingWarning
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


# Few or uneven points, and whether a smooth curve through them swings.
SWINGING = {
    "piston": ([0, 0.25 * np.pi, 0.75 * np.pi, np.pi, 2 * np.pi], [0, 1, 1, 0, 0], True),
    "tendon": ([-10, 0.0, 0.0033, 0.0123, 0.033, 0.0596, 9.2], [0, 0, 0.03, 0.227, 1, 2, 345.0], True),
    "stairs": (np.arange(9.0), [0, 0, 0, 0, 9, 9, 9, 9, 9], True),
    "muscle": ([0.5, 0.7, 0.9, 1.0, 1.1, 1.3, 1.5], [0, 0.6, 0.95, 1, 0.95, 0.6, 0], False),
    "line": ([0.0, 1.0, 5.0], [1.0, 3.0, 11.0], False),
    "two points": ([0.0, 1.0], [1.0, 3.0], False),
}


@pytest.mark.parametrize("name", SWINGING)
def test_a_curve_that_swings_says_so(name):
    x, y, swings = SWINGING[name]
    if swings:
        with pytest.warns(SwingWarning, match="it swings. Choose between='monotone'") as caught:
            Curve(x, y)
        assert caught[0].filename == __file__
        return
    curve = Curve(x, y)
    assert np.ptp(curve(np.linspace(x[0], x[-1], 2000))) < 1.3 * np.ptp(y)


def in_pieces(curve, x, n=201):
    """Return values (pieces, n) between neighbouring points."""
    return curve(x[:-1, None] + np.diff(x)[:, None] * np.linspace(0.0, 1.0, n))


@pytest.mark.parametrize("name", SWINGING)
def test_a_monotone_curve_rises_and_falls_as_its_points_do(name):
    x, y = (np.asarray(each, dtype=float) for each in SWINGING[name][:2])
    curve = Curve(x, y, between="monotone")
    assert np.abs(curve(x) - y).max() < 1e-12 * np.ptp(y)
    ways = np.diff(in_pieces(curve, x), axis=1) * np.where(np.diff(y) < 0.0, -1.0, 1.0)[:, None]
    assert ways.min() > -1e-12 * np.ptp(y)
    assert np.all(np.ptp(in_pieces(curve, x), axis=1)[np.diff(y) == 0.0] < 1e-12 * np.ptp(y))


def test_monotone_curves_through_random_points():
    rng = np.random.default_rng(5)
    for n in (2, 3, 4, 7, 40):
        for _ in range(40):
            x = np.cumsum(rng.uniform(0.01, 1.0, n) ** rng.integers(1, 3))
            y = rng.normal(size=n) if rng.random() < 0.5 else rng.integers(0, 3, n).astype(float)
            curve = Curve(x, y, between="monotone")
            ways = np.diff(in_pieces(curve, x, 60), axis=1) * np.sign(np.diff(y))[:, None]
            assert ways.min() > -1e-12
            for order in (1, 2):
                ends = curve.coefficients[:-1], np.diff(x)[:-1]
                left = np.polynomial.polynomial.polyder(ends[0].T, order)
                carried = [np.polynomial.polynomial.polyval(h, c) for c, h in zip(left.T, ends[1], strict=True)]
                scale = np.abs(curve.coefficients[:, order]).max(initial=1.0)
                right = curve.coefficients[1:, order] * (1.0 if order == 1 else 2.0)
                np.testing.assert_allclose(carried, right, rtol=1e-5, atol=1e-7 * scale)


def test_a_monotone_curve_is_near_a_smooth_function():
    for function in (np.exp, np.tanh, np.square):
        errors = []
        for n in (21, 41):
            x = np.linspace(0.0, 2.0, n)
            places = np.linspace(0.0, 2.0, 999)
            errors.append(np.abs(Curve(x, function(x), between="monotone")(places) - function(places)).max())
        assert errors[1] < 0.3 * errors[0] < 1e-2


def test_slopes_and_curvatures_can_be_given():
    curve = Curve(X, np.sin(X), slopes=np.cos(X), curvatures=-np.sin(X))
    places = np.linspace(0.0, 3.0, 301)
    for order, tolerance in enumerate((1e-5, 1e-4, 1e-3)):
        values = np.sin(places + order * np.pi / 2)
        np.testing.assert_allclose(curve(places, order), values, atol=tolerance)
        np.testing.assert_allclose(curve(X, order), np.sin(X + order * np.pi / 2), atol=1e-12)
    # Without curvatures it is as exact as the cubics.
    assert np.abs(Curve(X, np.sin(X), slopes=np.cos(X))(places) - np.sin(places)).max() < 3e-3
    x, y, _ = SWINGING["tendon"]
    flat = Curve(x, y, slopes=[0.0, 0.0, 10.0, 30.0, 37.0, 37.5, 37.5])
    assert np.abs(flat(np.linspace(-10.0, 0.0, 99))).max() < 1e-9


EXTREME_X = {
    "ordinary": np.array([0.0, 1.0, 2.0, 2.5, 4.0, 5.0, 6.0, 8.0]),
    "huge": 1.7e308 * np.linspace(-1.0, 1.0, 8),
    "far": 1e300 * np.arange(8.0),
    "tiny": 1e-300 * np.arange(8.0),
    "least": 5e-324 * np.arange(8.0),
    "uneven": np.array([-1e300, -1.0, 0.0, 1e-300, 1e-30, 1.0, 2.0, 1e20]),
    "close": 1.0 + 2.3e-16 * np.arange(8.0),
}
EXTREME_Y = {
    "ordinary": np.array([1.0, 2.0, 0.5, 0.5, 0.0, -1.0, 3.0, 1.0]),
    "huge": 1.7e308 * np.array([1.0, -1.0, 1.0, -1.0, -1.0, 1.0, 0.0, 1.0]),
    "tiny": 1e-300 * np.array([1.0, 2.0, 0.5, 0.5, 0.0, -1.0, 3.0, 1.0]),
    "least": 5e-324 * np.array([0.0, 0.0, 3.0, 1.0, 1.0, 7.0, 0.0, 0.0]),
    "uneven": np.array([-1e300, 0.0, 5e-324, 1e-300, 1.0, 1e300, 1e-20, 0.0]),
    "nothing": np.zeros(8),
}
WAYS = {
    "smooth": lambda x, y: {},
    "monotone": lambda x, y: {"between": "monotone"},
    "slopes": lambda x, y: {"slopes": np.gradient(y, x)},
    "flat": lambda x, y: {"slopes": 0.0 * y},
    "steep": lambda x, y: {"slopes": np.resize([1e308, -1e308, 5e-324], len(y))},
    "bent": lambda x, y: {"slopes": 0.0 * y, "curvatures": np.resize([1e308, -1e308, 0.0, 5e-324], len(y))},
}


def made_or_refused(x, y, options):
    try:
        return Curve(x, y, **options)
    except DescriptionError as error:
        told = str(error)
    assert re.search("x must increase|beyond what numbers can hold|expected finite", told), told
    return None


@pytest.mark.filterwarnings("ignore::leastaction.errors.SwingWarning")
@pytest.mark.parametrize("n", [2, 3, 5, 8])
@pytest.mark.parametrize("way", WAYS)
def test_extreme_numbers_end_in_a_curve_through_the_points_or_in_a_named_error(way, n):
    """Warnings are errors here: none may come of numbers that overflow on the way."""
    made = {}
    for i, j in itertools.product(EXTREME_X, EXTREME_Y):
        x, y = EXTREME_X[i][:n], EXTREME_Y[j][:n]
        with np.errstate(all="ignore"):
            options = WAYS[way](x, y)
        curve = made_or_refused(x, y, options)
        if curve is None:
            continue
        made[i, j] = curve
        assert np.isfinite(curve.coefficients).all()
        assert np.all(np.abs(curve(x) / 2.0 - y / 2.0) <= 1e-6 * np.abs(y).max()), (i, j)
    assert ("ordinary", "ordinary") in made or way in ("steep", "bent")
    # Units do not matter.
    if way in ("smooth", "monotone", "slopes"):
        usual = made["ordinary", "ordinary"]
        x, y = EXTREME_X["ordinary"][:n], EXTREME_Y["ordinary"][:n]
        for u, w in ((2.0**50, 2.0**900), (2.0**-50, 2.0**-700), (2.0**-150, 1.0)):
            curve = Curve(u * x, w * y, **WAYS[way](u * x, w * y))
            np.testing.assert_array_equal(curve(u * x + 0.3 * u), w * usual(x + 0.3))


@pytest.mark.filterwarnings("ignore::leastaction.errors.SwingWarning")
@pytest.mark.parametrize(("start", "end"), [(-1.7e308, 1.7e308), (0.0, 5e-324), (0.0, 1e300), (-1e-300, 1e-300)])
def test_a_function_over_an_extreme_range(start, end):
    for function in (lambda x: 1.0, lambda x: 1.7e308 if x > 0 else -1.7e308):
        with contextlib.suppress(DescriptionError):
            assert np.isfinite(Curve.from_function(function, start, end)(start))


BAD = {
    "curvatures alone": (lambda: Curve([0, 1], [0, 1], curvatures=[0, 0]), "curvatures and no slopes, which they need"),
    "slopes of another number": (lambda: Curve([0, 1], [0, 1], slopes=[0]), "slopes.*expected"),
    "slopes and monotone": (lambda: Curve([0, 1], [0, 1], slopes=[0, 0], between="monotone"), "slopes and between"),
    "between": (lambda: Curve([0, 1], [0, 1], between=[1]), "between: got .1.*expected 'smooth' or 'monotone'"),
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
