"""Identify a pendulum on a cart: the damping of both joints, the mass of the bob and the length of its rod.

The cart is pushed by a known force; its position and the angle of the pendulum are measured with noise. The four
unknown numbers are those whose simulation comes closest to the measurements. `scipy.optimize.least_squares` finds
them with the exact derivatives of the whole simulation by these numbers, from one call of `MidpointVI.sensitivity`,
and once more with finite differences, which take a simulation for every number.

    python -m benchmarks.studies.identify_cart_pendulum --out pictures
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import OptimizeResult, least_squares

from leastaction import Damping, Gravity, JointForce, Mechanism, MidpointVI, Trajectory, rz, tx, ty
from leastaction.viz.figures import BLUE, ORANGE, styled

NAMES = ["damping.x", "damping.theta", "bob.mass", "bob.value"]
UNITS = ["N s/m", "N m s/rad", "kg", "m"]
TRUTH = np.array([1.2, 0.05, 0.8, -0.6])
GUESS = np.array([0.3, 0.01, 0.5, -0.5])
NOISE = np.array([0.02, 0.04])  # of the position (m) and of the angle (rad)
START, V = np.array([0.0, 0.4]), np.zeros(2)
DT, SECONDS = 0.01, 8.0
MEASURED = 4  # every so many steps


def cart_pendulum() -> Mechanism:
    """Return the mechanism with the numbers of the guess; the bob is at the end of a rod along -y."""
    damping_x, damping_theta, mass, length = GUESS
    return Mechanism(
        [tx("x", name="cart", mass=2.0), [rz("theta"), [ty(length, name="bob", mass=mass)]]],
        [
            Gravity((0.0, -9.81, 0.0)),
            Damping({"x": damping_x, "theta": damping_theta}),
            JointForce("x", input="push"),
        ],
    )


def push(t: np.ndarray) -> np.ndarray:
    """Return the known force on the cart (N): a chirp that shakes both joints."""
    return 6.0 * np.sin(2.0 * t + 0.35 * t**2) * np.exp(-((t / 6.0) ** 4))


class Fit:
    """Residuals of a simulation against measurements (N, 2), and their derivatives, by the four numbers."""

    def __init__(self, measured: np.ndarray) -> None:
        self.mechanism = cart_pendulum()
        self.measured = measured
        self.simulations = 0
        self.last: tuple[np.ndarray, Trajectory] | None = None

    def simulate(self, numbers: np.ndarray, dt: float = DT) -> Trajectory:
        """Return the motion of the mechanism with other numbers; nothing is compiled again."""
        self.simulations += 1
        values = dict(zip(NAMES, numbers.tolist(), strict=True))
        vi = MidpointVI(self.mechanism.with_parameters(values))
        t = dt * np.arange(round(SECONDS / dt) + 1)
        forces = push(0.5 * (t[1:] + t[:-1]))[:, None]
        return vi.simulate(vi.start(START, V), t, inputs=forces)

    def residuals(self, numbers: np.ndarray) -> np.ndarray:
        """Return the differences to the measurements in units of their noise, as one vector."""
        run = self.simulate(numbers)
        self.last = numbers.copy(), run
        return ((run.q[::MEASURED] - self.measured) / NOISE).ravel()

    def jacobian(self, numbers: np.ndarray) -> np.ndarray:
        """Return the exact derivatives of `residuals`; the start's momentum depends on the numbers too."""
        # The solver asks for the derivatives where it has just asked for the residuals.
        known = self.last is not None and np.array_equal(self.last[0], numbers)
        run = self.last[1] if known else self.simulate(numbers)
        by = MidpointVI(run.mechanism, threads=1).sensitivity(run, NAMES, v=V).x[::MEASURED, :2]
        return (by / NOISE[:, None]).reshape(-1, len(NAMES))


@dataclass(frozen=True)
class Identified:
    """Estimates with their standard errors, and what each way of finding them took."""

    numbers: np.ndarray
    errors: np.ndarray
    chi2: float  # of the residuals, per degree of freedom: 1 if the model and the noise are right
    simulations: dict[str, int]
    seconds: dict[str, float]
    jacobian_errors: dict[str, float]  # relative to the largest entry of each column, at the estimate


def measurements() -> np.ndarray:
    """Return noisy measurements; their motion is simulated with steps ten times as short as the fit's."""
    fine = Fit(np.zeros((1, 2))).simulate(TRUTH, DT / 10.0)
    q = fine.q[:: 10 * MEASURED]
    return q + NOISE * np.random.default_rng(2012).standard_normal(q.shape)


def identify(measured: np.ndarray) -> Identified:
    """Fit with exact Jacobians and with finite differences, and compare the two."""
    found: dict[str, OptimizeResult] = {}
    simulations: dict[str, int] = {}
    seconds: dict[str, float] = {}
    jacobian_errors: dict[str, float] = {}
    for way in ("exact", "2-point", "3-point"):
        seconds[way] = np.inf
        for _ in range(5):  # the same every time; the quickest is the one that was disturbed least
            fit = Fit(measured)
            jac = fit.jacobian if way == "exact" else way
            begun = time.perf_counter()
            found[way] = least_squares(fit.residuals, GUESS, jac=jac, x_scale=np.abs(GUESS))
            seconds[way] = min(seconds[way], time.perf_counter() - begun)
        simulations[way] = fit.simulations
    best = found["exact"]
    exact = Fit(measured).jacobian(best.x)
    for way in ("2-point", "3-point"):
        off = np.abs(found[way].jac - Fit(measured).jacobian(found[way].x))
        jacobian_errors[way] = float((off.max(axis=0) / np.abs(exact).max(axis=0)).max())
    errors = np.sqrt(np.diag(np.linalg.inv(exact.T @ exact)))
    chi2 = float(best.fun @ best.fun) / (best.fun.size - len(NAMES))
    return Identified(best.x, errors, chi2, simulations, seconds, jacobian_errors)


@styled
def draw(measured: np.ndarray, found: Identified) -> Figure:
    """Return the figure: measurements, first guess and fit above, what the fit leaves below."""
    fit = Fit(measured)
    t = DT * MEASURED * np.arange(len(measured))
    fitted, guessed = (fit.simulate(n).q[::MEASURED] for n in (found.numbers, GUESS))
    figure = Figure(figsize=(9.0, 7.5), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True, height_ratios=[3, 3, 1.2, 1.2])
    labels = ("position of the cart (m)", "angle of the pendulum (rad)")
    for i, (axis, label) in enumerate(zip(axes[:2], labels, strict=True)):
        axis.plot(t, measured[:, i], ".", ms=5, color="0.65", label="measured")
        axis.plot(t, guessed[:, i], "--", lw=1, color=ORANGE, label="first guess")
        axis.plot(t, fitted[:, i], lw=1.5, color=BLUE, label="fit")
        axis.set_ylabel(label)
        rest = axes[2 + i]
        rest.plot(t, (measured - fitted)[:, i] / NOISE[i], ".", ms=3, color="0.3")
        rest.axhspan(-2.0, 2.0, color=BLUE, alpha=0.1, lw=0)
        rest.set(ylim=(-4.5, 4.5), yticks=(-2, 0, 2), ylabel=("cart", "pendulum")[i])
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    axes[2].set_title("measured less fit, in units of the noise; band: twice the noise", fontsize=10)
    axes[3].set(xlabel="time (s)", xlim=(0.0, t[-1]))
    return figure


def main(output: Path) -> Identified:
    """Identify, print and draw."""
    measured = measurements()
    found = identify(measured)
    print(f"{len(measured)} measurements of two variables, {SECONDS:g} s")
    print(f"{'number':15}{'truth':>8}{'guess':>8}{'estimate':>11}{'std. error':>12}{'off by':>12}")
    for i, name in enumerate(NAMES):
        off = (found.numbers[i] - TRUTH[i]) / found.errors[i]
        print(
            f"{name:15}{TRUTH[i]:8.3g}{GUESS[i]:8.3g}{found.numbers[i]:11.4f}{found.errors[i]:12.4f}"
            f"{off:+9.1f} std.   {UNITS[i]}"
        )
    print(f"residuals: chi^2 per degree of freedom {found.chi2:.3f}")
    for way, count in found.simulations.items():
        wrong = found.jacobian_errors.get(way)
        text = "" if wrong is None else f", Jacobian wrong by {wrong:.0e}"
        print(f"{way:8} Jacobians: {count:3} simulations, {1e3 * found.seconds[way]:5.0f} ms{text}")
    output.mkdir(parents=True, exist_ok=True)
    draw(measured, found).savefig(output / "identify_cart_pendulum.png", dpi=120)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
