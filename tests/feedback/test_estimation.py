"""Regulators, observers and Kalman filters, held to closed forms, least squares and statistics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from leastaction import Damping, Gravity, JointForce, Mechanism, MidpointSystem, MidpointVI, rx, tz
from leastaction.control import KalmanFilter, lqe, lqr
from leastaction.errors import ArgumentError
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.models.marionette import marionette, rest_pose
from leastaction.optimal import LinearSystem


def linear(seed: int = 0, nx: int = 4, nu: int = 2, ny: int = 2, N: int = 12):
    rng = np.random.default_rng(seed)
    A = np.eye(nx) + 0.2 * rng.standard_normal((nx, nx))
    B, C = rng.standard_normal((nx, nu)), rng.standard_normal((ny, nx))
    system = LinearSystem(A, B, N=N)
    return system, A, B, C, rng


@pytest.mark.parametrize("dt", [None, 0.1])
def test_lqr_and_lqe_solve_their_riccati_equations(dt):
    _, A, B, C, _ = linear(3)
    Q, R = np.diag([1.0, 2.0, 3.0, 4.0]), np.diag([0.5, 2.0])
    found = lqr(A, B, Q, R, dt=dt)
    P, K = found.P, found.gain
    if dt is None:
        residual = A.T @ P + P @ A + Q - P @ B @ np.linalg.solve(R, B.T @ P)
        assert found.poles.real.max() < 0.0
    else:
        residual = A.T @ P @ A - P + Q - A.T @ P @ B @ np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        assert np.abs(found.poles).max() < 1.0
    assert np.abs(residual).max() < 1e-10 * np.abs(P).max()
    assert np.allclose(K @ np.eye(4), K)
    observer = lqe(A, C, Q, R, dt=dt)
    dual = lqr(A.T, C.T, Q, R, dt=dt)
    assert np.allclose(observer.gain, dual.gain.T, atol=1e-12)
    assert np.allclose(np.sort_complex(observer.poles), np.sort_complex(dual.poles))


@pytest.mark.parametrize("discrete", [False, True])
def test_gains_are_those_of_python_control(discrete):
    control = pytest.importorskip("control")
    _, A, B, C, _ = linear(5)
    Q, R = np.diag([1.0, 2.0, 3.0, 4.0]), np.diag([0.5, 2.0])
    dt = 1.0 if discrete else None
    theirs = (control.dlqr if discrete else control.lqr)(A, B, Q, R)[0]
    assert np.abs(lqr(A, B, Q, R, dt=dt).gain - theirs).max() < 1e-10
    L, P, _ = (control.dlqe if discrete else control.lqe)(A, np.eye(4), C, Q, R)
    ours = lqe(A, C, Q, R, dt=dt)
    assert np.abs(ours.P - P).max() < 1e-10 * np.abs(P).max()
    assert np.abs(ours.gain - L).max() < 1e-10


def test_estimates_are_those_of_python_control():
    """Its estimator predicts: what it says of an instant is what the filter expects before the reading there."""
    control = pytest.importorskip("control")
    _, A, B, C, rng = linear(7, nu=1, N=40)
    A = 0.9 * A / np.abs(np.linalg.eigvals(A)).max()
    chance, V, P0, begun = (
        np.array([[0.3]]),
        np.diag([0.04, 0.01]),
        np.diag([0.5, 1.0, 0.2, 0.1]),
        [1.0, 0.0, -1.0, 0.5],
    )
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((41, 2))
    theirs = control.create_estimator_iosystem(control.ss(A, B, C, np.zeros((2, 1)), 0.1), chance, V, P0=P0)
    given = np.vstack([y.T, np.append(u, 0.0)])
    expected = control.input_output_response(theirs, 0.1 * np.arange(41), given, [*begun, *P0.ravel()]).states.T
    kalman = KalmanFilter(LinearSystem(A, B, N=40), measure=C, noise=V, process=B @ chance @ B.T, x=begun, spread=P0)
    ours = kalman.run(y, u)
    np.testing.assert_allclose(ours.x_predicted, expected[:, :4], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(ours.P_predicted.reshape(41, 16), expected[:, 4:], rtol=0.0, atol=1e-10)


def record(system, A, B, C, rng, W, V, P0):
    x = [rng.multivariate_normal(np.zeros(len(A)), P0)]
    u = rng.standard_normal((system.N, B.shape[1]))
    for row in u:
        x.append(A @ x[-1] + B @ row + rng.multivariate_normal(np.zeros(len(A)), W))
    y = np.array([C @ state + rng.multivariate_normal(np.zeros(len(C)), V) for state in x])
    return np.array(x), u, y


@pytest.mark.parametrize("kind", ["extended", "unscented"])
def test_filter_and_smoother_are_least_squares(kind):
    """Of a linear system the last estimate, and all that is smoothed, minimise the sum of weighted squares."""
    system, A, B, C, rng = linear()
    N, nx = system.N, len(A)
    W, V, P0 = np.diag([0.1, 0.2, 0.1, 0.3]) ** 2, np.array([[0.04, 0.01], [0.01, 0.09]]), np.diag([1.0, 2.0, 1.0, 0.5])
    _, u, y = record(system, A, B, C, rng, W, V, P0)
    kalman = KalmanFilter(system, measure=C, noise=V, process=W, x=np.zeros(nx), spread=P0, kind=kind)
    estimate = kalman.run(y, u)
    smooth, P = estimate.smoothed(system)

    def least_squares(last):
        rows, values = [], []

        def add(blocks, value, covariance):
            root = np.linalg.inv(np.linalg.cholesky(covariance))
            row = np.zeros((len(value), (last + 1) * nx))
            for k, block in blocks:
                row[:, k * nx : (k + 1) * nx] = block
            rows.append(root @ row)
            values.append(root @ value)

        add([(0, np.eye(nx))], np.zeros(nx), P0)
        for k in range(last + 1):
            add([(k, C)], y[k], V)
        for k in range(last):
            add([(k, -A), (k + 1, np.eye(nx))], B @ u[k], W)
        H = np.vstack(rows)
        return (np.linalg.lstsq(H, np.concatenate(values), rcond=None)[0].reshape(-1, nx), np.linalg.inv(H.T @ H))

    best, spread = least_squares(N)
    assert np.abs(smooth - best).max() < 1e-9
    assert np.abs(P[3] - spread[3 * nx : 4 * nx, 3 * nx : 4 * nx]).max() < 1e-9
    early, _ = least_squares(5)
    assert np.abs(estimate.x[5] - early[-1]).max() < 1e-9


def arm() -> Mechanism:
    tree = [rx("a"), [tz(-1.0, mass=2.0), [rx("b"), [tz(-0.8, mass=1.0)]]]]
    motors = [JointForce(name, input=f"torque_{name}") for name in ("a", "b")]
    return Mechanism(tree, [Gravity(), Damping(0.1), *motors])


def simulated(system, x0, u, rng, spread_p, names, read, noise):
    x, y = [x0], [read(x0) + noise * rng.standard_normal(len(read(x0)))]
    for k, row in enumerate(u):
        state = system.f(x[-1], row, k).copy()
        state[names] += spread_p * rng.standard_normal(len(names))
        x.append(state)
        y.append(read(state) + noise * rng.standard_normal(len(read(state))))
    return np.array(x), np.array(y)


@pytest.mark.parametrize("kind", ["extended", "unscented"])
def test_arm_with_encoders_is_consistent(kind):
    """The normalised innovations of 500 readings have the mean and the spread that chance gives them."""
    system = MidpointSystem(MidpointVI(arm()), np.linspace(0.0, 5.0, 501))
    rng = np.random.default_rng(7)
    u = np.stack([3.0 * np.sin(2.0 * system.t[:-1]), np.cos(3.0 * system.t[:-1])], axis=1)
    x0 = np.array([0.3, -0.2, 0.0, 0.0])
    x, y = simulated(system, x0, u, rng, 5e-3, [2, 3], lambda x: x[:2], 2e-3)
    start = x0 + np.array([0.02, 0.02, 0.1, 0.1]) * rng.standard_normal(4)
    kalman = KalmanFilter(
        system, measure=["a", "b"], noise=2e-3, process={"p_*": 5e-3}, x=start,
        spread={"a": 0.02, "b": 0.02, "p_*": 0.1}, kind=kind,
    )  # fmt: skip
    estimate = kalman.run(y, u)
    low, high = chi2.ppf([1e-3, 1.0 - 1e-3], 2 * 501) / 501
    assert low < estimate.surprise.mean() < high
    off = estimate.x - x
    nees = np.einsum("ki,kij,kj->k", off[50:], np.linalg.inv(estimate.P[50:]), off[50:])
    assert 3.0 < nees.mean() < 5.2  # 4 in the mean; correlated over time
    smooth, _ = estimate.smoothed(system)
    assert np.abs(smooth - x)[50:-50, 2:].mean() < 0.8 * np.abs(off)[50:-50, 2:].mean()


def test_constraints_are_kept_and_the_covariance_is_tangent():
    m = four_bars()
    vi = MidpointVI(m)
    t = np.linspace(0.0, 0.5, 51)
    q0 = at_angle(m, 1.0, 0.0)[0]
    system = MidpointSystem(vi, t)
    x0 = np.concatenate([q0, np.zeros(m.nd), np.zeros(m.nrho)])
    u = np.zeros((50, system.nu))
    rng = np.random.default_rng(0)
    x, y = simulated(system, x0, u, rng, 0.0, [], lambda x: x[:1], 1e-3)
    Z = np.linalg.qr(system.start_directions(x0, None))[0]
    off = Z @ (0.02 * rng.standard_normal(Z.shape[1]))
    kalman = KalmanFilter(
        system, measure=[m.variables[0]], noise=1e-3, process=1e-4, x=system.moved_start(x0, off), spread=0.05
    )
    estimate = kalman.run(y, u)
    assert max(np.abs(m.constraint_values(state[: m.nq])).max() for state in estimate.x) < 1e-9
    assert np.linalg.matrix_rank(estimate.P[0], tol=1e-9) == Z.shape[1]
    normal = m.constraint_jacobian(np.ascontiguousarray(estimate.x[-1][: m.nq]))
    assert np.abs(normal @ estimate.P[-1][: m.nq]).max() < 1e-6 * np.abs(estimate.P[-1]).max() + 1e-9
    assert np.abs(estimate.x[-1] - x[-1])[: m.nq].max() < 5e-3


MARKERS = [
    "head_center",
    "lhand",
    "rhand",
    "lfoot_end",
    "rfoot_end",
    "lfemur_end",
    "rfemur_end",
    "lhumerus_end",
    "pelvis",
]


def test_a_marionette_seen_by_markers_is_consistent():
    """Hung on its six strings, knocked about by chance, and seen as a capture sees it: places of markers, to 2 mm."""
    m, N, noise, chance = marionette(), 40, 2e-3, 2e-4
    system = MidpointSystem(MidpointVI(m, threads=1), 0.01 * np.arange(N + 1))
    rng = np.random.default_rng(11)
    start = system.integrator.start(rest_pose(m)).x
    rho = slice(m.nd, m.nq)
    wave = 0.03 * np.sin(6.0 * system.t[1:])[:, None] * rng.uniform(-1.0, 1.0, m.nrho)
    u = start[rho] + wave

    def markers(x: np.ndarray) -> np.ndarray:
        return m.positions(np.ascontiguousarray(x[: m.nq]), MARKERS).ravel()

    def knocked(x: np.ndarray, deviations: np.ndarray) -> np.ndarray:
        Z = np.linalg.qr(system.start_directions(x, None))[0]
        return system.moved_start(x, Z @ (Z.T @ (deviations * rng.standard_normal(m.nx))))

    momenta = np.repeat([0.0, chance, 0.0], [m.nq, m.nd, m.nrho])
    at_first = np.repeat([0.03, 0.0, 2e-3, 0.0], [m.nd, m.nrho, m.nd, m.nrho])
    x, y = [start], [markers(start)]
    for row in u:
        x.append(knocked(np.array(system.f(x[-1], row, 0)), momenta))
        y.append(markers(x[-1]))
    readings = np.array(y) + noise * rng.standard_normal((N + 1, 3 * len(MARKERS)))
    kalman = KalmanFilter(
        system, measure=markers, noise=noise, process=momenta, x=knocked(start, at_first), spread=at_first
    )
    estimate = kalman.run(readings, u)
    low, high = chi2.ppf([1e-3, 1.0 - 1e-3], readings.size) / (N + 1)
    assert low < estimate.surprise.mean() < high
    assert max(np.abs(m.constraint_values(state[: m.nq])).max() for state in estimate.x) < 1e-9
    off = np.abs(np.array([markers(state) for state in estimate.x]) - y)
    assert off[20:].mean() < 0.6 * noise  # better than what is read: the dynamics know more


def test_what_is_wrong_is_said():
    system, *_ = linear()
    good = {"measure": np.eye(4), "noise": 0.1, "process": 0.1, "x": np.zeros(4)}
    for change, words in (
        ({"measure": ["x[9]"]}, "unknown name 'x\\[9\\]'"),
        ({"measure": np.eye(3)}, "measure: got shape"),
        ({"noise": 0.0}, "noise: got a covariance with the eigenvalue 0"),
        ({"process": {"p_*": 1.0}}, "process: unknown name 'p_\\*'"),
        ({"process": -1.0}, "none below zero"),
        ({"x": np.zeros(3)}, "x: got shape"),
        ({"kind": "particle"}, "kind"),
    ):
        with pytest.raises(ArgumentError, match=words):
            KalmanFilter(system, **{**good, **change})
    with pytest.raises(ArgumentError, match="y: got nan"):
        KalmanFilter(system, **good).correct([np.nan, 0.0, 0.0, 0.0])


def test_what_is_read_may_be_names_a_matrix_a_function_or_a_quantity():
    """Markers on the links, and angles, whichever way they are given."""
    system = MidpointSystem(MidpointVI(arm()), np.linspace(0.0, 0.2, 11))
    x0, m = np.array([0.3, -0.2, 0.0, 0.0]), arm()
    ways = [["a", "b"], np.eye(4)[:2], lambda x: x[:2], system.quantity("state").select([0, 1])]
    found = []
    for measure in ways:
        kalman = KalmanFilter(system, measure=measure, noise=0.01, process=0.01, x=x0, spread=0.1)
        found.append(kalman.correct([0.31, -0.22]).copy())
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-9)

    def marker(x: np.ndarray) -> np.ndarray:
        return m.positions(x[:2], ["rx(b)/tz(-0.8)"])[0]

    start = x0 + np.array([0.02, 0.02, 0.0, 0.0])
    kalman = KalmanFilter(system, measure=marker, noise=1e-3, process=0.01, x=start, spread=0.1)
    for _ in range(6):
        kalman.correct(marker(x0))
    np.testing.assert_allclose(marker(kalman.x), marker(x0), atol=1e-3)
