"""Parameters from noisy measurements: against closed forms, SciPy with a model of its own, and many repetitions."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from leastaction.errors import ArgumentError, ResidualWarning
from leastaction.identification import Experiment, identify
from leastaction.identification.model import Measured
from leastaction.mechanics import (
    Damping,
    Distance,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    MidpointVI,
    project_configuration,
    rx,
    tx,
    ty,
    tz,
)
from leastaction.optimal import Parameter


def slide(stiffness: float = 9.0, damping: float = 0.4, mass: float = 1.0) -> Mechanism:
    elements = [JointSpring("x", stiffness, name="spring"), Damping(damping, name="oil"), JointForce("x", input="push")]
    return Mechanism([tx("x", mass=mass)], elements)


def swinging(m: Mechanism, t: np.ndarray, q: list[float], noise: float, seed: int, inputs: object = None) -> np.ndarray:
    vi = MidpointVI(m, threads=1)
    x = vi.simulate(vi.start(q), t, inputs=inputs).q  # type: ignore[arg-type]
    return np.asarray(x + noise * np.random.default_rng(seed).normal(size=x.shape))


def test_a_fall_is_a_linear_regression() -> None:
    """``z = z0 + v0 t - g t^2 / 2``: estimates, covariance and sum of squares are those of the normal equations."""
    t, sigma = np.linspace(0.0, 1.0, 41), 0.01
    rng = np.random.default_rng(3)
    z = 2.0 + 0.7 * t - 0.5 * 3.7 * t**2 + sigma * rng.normal(size=t.size)
    z[[5, 17, 18]] = np.nan
    m = Mechanism([tz("z", mass=1.3)], [Gravity((0.0, 0.0, -9.81), name="gravity")])
    (name,) = (name for name in m.parameters if name.startswith("gravity") and name.endswith("z"))
    found = identify(m, Experiment(t, {"z": z}, sigma), [name])
    known = ~np.isnan(z)
    X = np.stack([np.ones_like(t), t, 0.5 * t**2], axis=1)[known]
    best = np.linalg.solve(X.T @ X, X.T @ z[known])
    covariance = sigma**2 * np.linalg.inv(X.T @ X)
    assert found[name] == pytest.approx(best[2], rel=1e-8)
    assert found.errors[name] == pytest.approx(np.sqrt(covariance[2, 2]), rel=1e-6)
    assert found.chi_squared == pytest.approx(np.sum((z[known] - X @ best) ** 2) / sigma**2, rel=1e-8)
    assert found.freedom == known.sum() - 3
    assert found.success
    assert abs(found[name] + 3.7) < 4.0 * found.errors[name]


def test_it_finds_what_scipy_finds_with_a_model_of_its_own() -> None:
    """A pendulum with damping from a pushed motion, in continuous time by SciPy: steps are short enough to agree."""
    t, sigma, length = np.linspace(0.0, 3.0, 151), 0.01, 0.8
    m = Mechanism(
        [rx("a"), [tz(-length, mass=1.0, name="bob")]],
        [Gravity((0.0, 0.0, -9.81)), Damping(0.1, name="air"), JointForce("a", input="u")],
    )

    def push(time: float) -> float:
        return 1.5 * float(np.sin(4.0 * time))

    def motion(p: np.ndarray) -> np.ndarray:
        mass, damping, a0, w0 = p

        def rate(time: float, y: np.ndarray) -> list[float]:
            torque = push(time) - damping * y[1] - mass * 9.81 * length * np.sin(y[0])
            return [y[1], torque / (mass * length**2)]

        return np.asarray(solve_ivp(rate, (0.0, 3.0), [a0, w0], t_eval=t, rtol=1e-10, atol=1e-12).y[0])

    truth = np.array([1.4, 0.25, 0.5, -0.3])
    a = motion(truth) + sigma * np.random.default_rng(1).normal(size=t.size)
    peer = least_squares(lambda p: (a - motion(p)) / sigma, [1.0, 0.1, a[0], 0.0], x_scale="jac", xtol=1e-12)
    covariance = np.linalg.inv(peer.jac.T @ peer.jac)
    experiment = Experiment(t, {"a": a}, sigma, inputs={"u": push})
    found = identify(m, experiment, ["bob.mass", "air.a"], substeps=4)
    np.testing.assert_allclose([found["bob.mass"], found["air.a"]], peer.x[:2], rtol=2e-4)
    np.testing.assert_allclose(list(found.errors.values()), np.sqrt(np.diag(covariance))[:2], rtol=1e-2)
    np.testing.assert_allclose(found.covariance, covariance[:2, :2], rtol=2e-2)
    assert found.chi_squared == pytest.approx(2.0 * peer.cost, rel=1e-3)
    assert found.success


def test_standard_errors_cover_what_they_should() -> None:
    """Of 100 repetitions, 95 % lie within 1.96 of them, give or take; scaled errors are of variance one."""
    t, sigma = np.linspace(0.0, 3.0, 61), 0.01
    names, truth = ["spring.stiffness", "oil.x"], np.array([9.0, 0.4])
    off = []
    for seed in range(100):
        x = swinging(slide(), t, [0.2], sigma, seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResidualWarning)  # one in some hundred is unlikely
            found = identify(slide(8.0, 0.3), Experiment(t, {"x": x[:, 0]}, sigma), names, horizons=[1.0])
        assert found.converged
        off.append((np.array([found[name] for name in names]) - truth) / [found.errors[name] for name in names])
    scaled = np.array(off)
    inside = np.mean(np.abs(scaled) < 1.96)
    assert 0.90 < inside < 0.99  # 200 draws: 0.95 +- 0.015
    assert 0.8 < scaled.std() < 1.2
    assert abs(scaled.mean()) < 0.25


def test_a_horizon_that_grows_finds_what_all_at_once_does_not() -> None:
    """A guess of the stiffness that is off by a factor of five: over many swings other minima lie between."""
    t = np.linspace(0.0, 12.0, 601)
    x = swinging(slide(damping=0.05), t, [0.2], 0.005, 4)
    experiment = Experiment(t, {"x": x[:, 0]}, 0.005)
    start = slide(1.8, 0.05)
    with pytest.warns(ResidualWarning):
        at_once = identify(start, experiment, ["spring.stiffness"], horizons=[1.0])
    found = identify(start, experiment, ["spring.stiffness"])
    assert found.success
    assert abs(found["spring.stiffness"] - 9.0) < 4.0 * found.errors["spring.stiffness"]
    assert at_once.chi_squared > 100.0 * found.chi_squared
    assert found.horizons[-1] == 1.0
    assert len(found.horizons) > 1


def test_a_run_is_no_experiment() -> None:
    m = Mechanism([tx("x", mass=1.0)], [JointSpring("x", 9.0, name="spring")])
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.1]), np.linspace(0.0, 1.0, 11))
    with pytest.raises(ArgumentError, match=r"data\[0\]: got Trajectory, expected an? Experiment"):
        identify(m, run, ["spring.stiffness"])  # type: ignore[arg-type]


def test_several_experiments_share_their_numbers() -> None:
    """Two motions, with other pushes and starts: what one says little of, the other tells."""
    t, sigma = np.linspace(0.0, 2.0, 101), 0.005
    pushes = [np.zeros((100, 1)), 2.0 * np.sin(5.0 * t[:-1])[:, None]]
    data = [
        Experiment(
            t,
            {"x": swinging(slide(mass=1.5), t, [0.3], sigma, i, u)[:, 0]},
            sigma,
            inputs={"push": u[:, 0]},
            name=f"run {i}",
        )
        for i, u in enumerate(pushes)
    ]
    names = ["spring.stiffness", "oil.x", "x.mass"]
    found = identify(slide(7.0, 0.3, 1.2), data, names)
    assert found.success, found
    truth = dict(zip(names, (9.0, 0.4, 1.5), strict=True))
    assert all(abs(found[name] - truth[name]) < 4.0 * found.errors[name] for name in names)
    alone = identify(slide(7.0, 0.3, 1.2), data[1], names)
    assert all(found.errors[name] < alone.errors[name] for name in names)
    # Without a push only the ratios are told.
    with pytest.warns(ResidualWarning, match="do not tell 'spring.stiffness' and 'oil.x' and 'x.mass' apart"):
        blind = identify(slide(7.0, 0.3, 1.2), data[0], names)
    assert all(np.isinf(blind.errors[name]) for name in names)
    # Until one of them is known from elsewhere.
    weighed = identify(slide(7.0, 0.3), data[0], [*names[:2], Parameter("x.mass", weight=1e4, wanted=1.5)])
    assert weighed.errors["x.mass"] == pytest.approx(0.01, rel=1e-3)
    assert weighed.errors["spring.stiffness"] >= 9.0 * 0.01 / 1.5 * 0.99


def test_places_of_frames_and_rates_are_measurements() -> None:
    """Lengths, where the frame itself is elsewhere on another body, from a camera and a gyroscope."""

    def arm(length: float, mass: float) -> Mechanism:
        return Mechanism(
            [rx("a"), [tz(-length, name="elbow", mass=0.5), [rx("b"), [tz(-0.4, name="hand", mass=mass)]]]],
            [Gravity((0.0, 0.0, -9.81))],
        )

    t, rng = np.linspace(0.0, 1.5, 91), np.random.default_rng(5)
    vi = MidpointVI(arm(0.6, 0.8), threads=1)
    run = vi.simulate(vi.start([0.9, -0.4]), t)
    hand = run.mechanism.positions(run.q, ["hand"])[:, 0] + 0.003 * rng.normal(size=(91, 3))
    gyro = np.diff(run["b"]) / np.diff(t) + 0.05 * rng.normal(size=90)
    name = "elbow.value"  # of its place along z
    experiment = Experiment(
        t, {"hand": hand, "rate of b": gyro}, {"hand": 0.003, "rate of *": 0.05}, start=([0.8, -0.3], [0.0, 0.0])
    )
    found = identify(arm(0.55, 0.6), experiment, [name, "hand.mass"], horizons=[0.3, 1.0])
    assert found.success, found
    assert abs(found[name] + 0.6) < 4.0 * found.errors[name]
    assert abs(found["hand.mass"] - 0.8) < 4.0 * found.errors["hand.mass"]
    assert set(found.residuals[0]) == {"hand.x", "hand.y", "hand.z", "rate of b"}


def test_a_closed_loop_starts_on_its_constraints() -> None:
    """The start of a loop is found along the tangent of its constraint."""

    def loop(stiffness: float) -> Mechanism:
        tree = [ty("y", mass=1.0, name="slider"), [rx("a"), [tz(-0.7, mass=0.4, name="end")]]]
        elements = [
            Gravity((0.0, 0.0, -9.81)),
            JointSpring("y", stiffness, name="spring"),
            Distance("world", "end", 1.0),
        ]
        return Mechanism(tree, elements)

    t = np.linspace(0.0, 1.5, 151)
    m = loop(20.0)
    q = project_configuration(m, [0.4, 0.6]).q
    y = swinging(m, t, q.tolist(), 0.001, 6)
    found = identify(loop(14.0), Experiment(t, {"y": y[:, 0], "a": y[:, 1]}, 0.001), ["spring.stiffness"])
    assert found.success, found
    assert abs(found["spring.stiffness"] - 20.0) < 4.0 * found.errors["spring.stiffness"]


def test_a_known_start_is_held() -> None:
    t = np.linspace(0.0, 2.0, 101)
    vi = MidpointVI(slide(mass=1.5), threads=1)
    x = vi.simulate(vi.start([0.2], [0.5]), t)["x"] + 0.002 * np.random.default_rng(8).normal(size=101)
    experiment = Experiment(t, {"x": x}, 0.002, start=([0.2], [0.5]), free_start=False)
    found = identify(slide(7.0, 0.4, 1.2), experiment, ["spring.stiffness", Parameter("oil.x", 0.0, 2.0)])
    # Rest to be told: with the velocity known, and the mass free, its momentum moves with the mass.
    both = identify(slide(9.0, 0.4, 1.2), experiment, ["x.mass", "oil.x"])
    assert found.freedom == 99
    assert both.success, both
    assert abs(both["x.mass"] - 1.5) < 4.0 * both.errors["x.mass"]
    assert both.runs[0]["x"][0] == 0.2


def test_residuals_that_are_not_noise_are_warned_of() -> None:
    """Damping that the model does not have; noise that is larger, and less, than was said."""
    t = np.linspace(0.0, 4.0, 201)
    x = swinging(slide(), t, [0.2], 0.002, 7)[:, 0]
    frictionless = Mechanism([tx("x", mass=1.0)], [JointSpring("x", 7.0, name="spring")])
    with pytest.warns(ResidualWarning) as caught:
        found = identify(frictionless, Experiment(t, {"x": x}, 0.002), ["spring.stiffness"])
    said = [str(each.message) for each in caught]
    assert any("times what sigma says: the model misses something" in each for each in said)
    assert any("neighbouring residuals of 'x'" in each for each in said)
    assert not found.success
    assert found.doubts == tuple(said)
    assert found.doubts[0] in str(found)
    for sigma, what in ((0.001, "the noise is larger"), (0.01, "the noise is less than was given")):
        with pytest.warns(ResidualWarning, match=what):
            identify(slide(8.0), Experiment(t, {"x": x}, sigma), ["spring.stiffness", "oil.x"])
    # Whose size is not known is taken from them.
    taken = identify(slide(8.0), Experiment(t, {"x": x}), ["spring.stiffness", "oil.x"])
    known = identify(slide(8.0), Experiment(t, {"x": x}, 0.002), ["spring.stiffness", "oil.x"])
    assert np.sqrt(taken.reduced) == pytest.approx(0.002, rel=0.15)
    assert taken.errors["oil.x"] == pytest.approx(known.errors["oil.x"] * np.sqrt(known.reduced), rel=1e-6)


def test_an_estimate_at_its_bound_is_told() -> None:
    t = np.linspace(0.0, 2.0, 101)
    x = swinging(slide(damping=0.0), t, [0.2], 0.002, 9)[:, 0]
    with pytest.warns(ResidualWarning) as caught:
        identify(slide(7.0, 0.0), Experiment(t, {"x": x}, 0.002), [Parameter("spring.stiffness", 2.0, 8.0)])
    assert "'spring.stiffness' is at its bound" in [str(each.message) for each in caught]


@pytest.mark.parametrize(
    ("experiment", "parameters", "message"),
    [
        ({"measured": {"y": np.zeros(11)}}, ["oil.x"], "unknown variable or frame 'y'"),
        ({"measured": {"x": np.zeros(10)}}, ["oil.x"], r"measured\['x'\]: got"),
        ({"measured": {"x": np.full(11, np.nan)}}, ["oil.x"], "nothing but NaN"),
        ({"measured": {}}, ["oil.x"], "measured: got nothing"),
        ({"sigma": -1.0}, ["oil.x"], "sigma"),
        ({"sigma": 1e-300}, ["oil.x"], "^identify: the residuals at the start, .* a larger sigma"),
        ({"sigma": {"y": 1.0}}, ["oil.x"], "sigma: got none for 'x'"),
        ({"inputs": {"pull": 1.0}}, ["oil.x"], "unknown input or prescribed variable 'pull'"),
        ({"inputs": {"push": np.zeros(3)}}, ["oil.x"], r"inputs\['push'\]"),
        ({}, ["oil.y"], "unknown parameter 'oil.y'"),
        ({}, [], "expected one or several"),
        ({}, ["oil.x", "oil.x"], "each once"),
    ],
)
def test_what_is_wrong_is_named(experiment: dict, parameters: list, message: str) -> None:  # type: ignore[type-arg]
    given = {"t": np.linspace(0.0, 1.0, 11), "measured": {"x": np.zeros(11)}, "sigma": 1.0} | experiment
    with pytest.raises(ArgumentError, match=message):
        identify(slide(), Experiment(**given), parameters)


@pytest.mark.parametrize("horizons", [[], [0.5], [1.0, 0.5, 1.0], [0.0, 1.0]])
def test_horizons_grow_to_the_whole(horizons: list[float]) -> None:
    with pytest.raises(ArgumentError, match="horizons"):
        identify(slide(), Experiment(np.linspace(0.0, 1.0, 11), {"x": np.zeros(11)}), ["oil.x"], horizons=horizons)


def test_a_start_on_a_string_whose_ends_are_moved_is_free_in_all_that_it_can_move():
    """A string whose other end and length are given is a condition on the bob alone: four directions in all states."""
    m = Mechanism(
        [tx("rail", kinematic=True, name="hook"), tx("x"), [ty("y"), [tz("z", name="bob", mass=1.0)]]],
        [Gravity(), Distance("hook", "bob", "reel", name="string")],
    )
    t = 0.01 * np.arange(11)
    rng = np.random.default_rng(2)
    for _ in range(20):
        way = rng.normal(size=3)
        rail, length = rng.normal(), float(np.linalg.norm(way))
        q = m.configuration({"x": rail + way[0], "y": way[1], "z": way[2], "rail": rail, "reel": length})
        inputs = {"rail": rail, "reel": length}
        seen = Experiment(t, {"x": np.full(11, q[0])}, 0.01, start=(q, np.zeros(m.nv)), inputs=inputs)
        fit = Measured(seen, MidpointVI(m), ["bob.mass"], 1)
        Z = fit.directions
        assert Z.shape == (m.ndx, 4)  # two directions of the bob and as many of its momentum
        assert not Z[[*range(m.nd, m.nv), *range(m.nv + m.nd, m.ndx)]].any()
        assert np.linalg.matrix_rank(Z) == 4
