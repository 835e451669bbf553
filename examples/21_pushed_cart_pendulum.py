"""A pendulum on a cart is pushed about and catches itself: predictive control on estimates by noisy, late readings.

The controller's model has a bob a fifth too light; it reads the cart's place and the angle, two hundredths of a second
late, and may push with 80 N on a track of two metres.

    python examples/21_pushed_cart_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.control import MPC, ClosedLoop, KalmanFilter, monte_carlo
from leastaction.costs import tracking
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.viz import save_png

T = np.arange(351) * 0.02
UP = np.array([0.0, np.pi, 0.0, 0.0])
PUSHES = {1.0: 0.6, 3.0: -0.8, 5.0: 0.6}  # momenta (kg m^2/s) that knocks at the bob add


def knock(t: float, _: np.ndarray) -> np.ndarray:
    """Return what a knock adds to the state at a time."""
    return np.array([0.0, 0.0, 0.0, sum(size for at, size in PUSHES.items() if abs(t - at) < 1e-6)])


def run(rng: np.random.Generator) -> ClosedLoop:
    """Return one run of the loop, with a bob and a start drawn by chance."""
    model = la.MidpointSystem(la.MidpointVI(cart_pendulum(bob_mass=1.0), threads=1), T[:51])
    cost = tracking(model, {"x": 5.0, "theta": 30.0, "*.v": 1.0}, {"theta": np.pi}, effort=1e-3)
    mpc = MPC(model, cost, [la.Bound("x-force", -80.0, 80.0), la.Bound("x", -1.0, 1.0)])
    kalman = KalmanFilter(model, measure=["x", "theta"], noise=1e-3, process={"p_*": 0.02}, x=UP, spread=0.05)
    plant = la.MidpointVI(cart_pendulum(bob_mass=rng.uniform(1.0, 1.4)))
    start = [0.0, np.pi + 0.05 * rng.standard_normal()]
    sensors = {"measure": ["x", "theta"], "noise": 1e-3, "delay": 0.02, "estimator": kalman}
    return la.simulate(plant, start, None, T, inputs=mpc, **sensors, disturbance=knock, seed=int(rng.integers(1000)))


def main(output: Path, runs: int = 8) -> ClosedLoop:
    """Run once and many times, print and draw."""
    one = run(np.random.default_rng(0))
    print(f"it leans by up to {np.degrees(np.abs(one['theta'] - np.pi).max()):.0f} degrees and stands again")
    print(f"a call takes {1e3 * np.median([info.seconds for info in one.infos]):.1f} ms")
    output.mkdir(parents=True, exist_ok=True)
    bands = monte_carlo(run, runs)
    stand = np.abs(bands["theta"][:, -1] - np.pi) < 0.1
    print(f"{stand.sum()} of {runs} stand at the end, with bobs of 1 to 1.4 kg")
    save_png(bands.plot(["theta", "x", "x-force"]), output / "21_pushed_cart_pendulum.png")
    system = la.MidpointSystem(la.MidpointVI(cart_pendulum()), one.t)
    view = la.show(system.trajectory(one.x, one.u), traces=["bob"], title="Pushed about")
    view.save(output / "21_pushed_cart_pendulum.html")
    return one


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
