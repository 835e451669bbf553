"""Eighty swing-ups, by how heavy the bob is and how strong the push may be, on a cluster of processes by Dask.

Here the cluster is this machine. With the address of a scheduler in place of `LocalCluster` it is of many, and nothing
else changes. What is done is kept: a sweep that was ended goes on where it was.

    python examples/32_swing_ups_on_a_cluster.py --out pictures
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.control import sweep
from leastaction.errors import MissingExtraError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.viz import VERMILION, new_figure, save_png, styled

try:
    import joblib
    from dask.distributed import Client, LocalCluster
except ImportError as error:
    raise MissingExtraError("this example needs joblib and Dask: pip install 'leastaction[cluster]'") from error

BOBS, PUSHES = np.linspace(0.5, 4.0, 8), np.linspace(30.0, 75.0, 10)  # kg, N
T = 0.02 * np.arange(201)


def swing_up(bob_and_push: tuple[float, float]) -> tuple[float, float]:
    """Return the angle (rad) at the end of the cheapest motion of 4 s, and its effort (N^2 s)."""
    bob, push = bob_and_push
    system = la.MidpointSystem(la.MidpointVI(cart_pendulum(bob_mass=bob), threads=1), T)
    weights = {"Q": [0.1, 0.1, 1e-3, 1e-3], "R": [1e-3], "Q_final": [1e4, 1e4, 1e3, 1e3]}
    cost = la.QuadraticCost([0.0, np.pi, 0.0, 0.0], [0.0], **weights)
    found = la.optimize(system, cost, initial=(np.zeros(4), [0.0]), limits=[la.Bound("x-force", -push, push)])
    return float(found.x[-1, 1]), float(0.02 * np.sum(found.u**2))


@styled
def main(output: Path) -> np.ndarray:
    """Sweep, print and draw; return where the bob ends (rad), by push and bob."""
    values = [(float(bob), float(push)) for push in PUSHES for bob in BOBS]
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with tempfile.TemporaryDirectory() as keep, cluster, Client(cluster), joblib.parallel_config(backend="dask"):
        found = sweep(swing_up, values, keep=keep)
        done = []
        sweep(swing_up, values, keep=keep, progress=lambda count, _: done.append(count))
    angle, effort = np.array(found).T.reshape(2, len(PUSHES), len(BOBS))
    stands = np.abs(angle - np.pi) < 0.1
    print(
        f"{len(found)} swing-ups: {stands.sum()} stand after 4 s, with at least {PUSHES[stands.any(axis=1)][0]:.0f} N"
    )
    print(f"they take {effort[stands].min():.0f} to {effort[stands].max():.0f} N^2 s")
    print(f"the same sweep again: {done[0]} of them had been kept")
    output.mkdir(parents=True, exist_ok=True)
    panel = (figure := new_figure(8.0, 5.0)).subplots()
    drawn = panel.pcolormesh(BOBS, PUSHES, np.where(stands, effort, np.nan), cmap="viridis")
    figure.colorbar(drawn, label="effort of the push (N² s)")
    bob, push = np.meshgrid(BOBS, PUSHES)
    panel.plot(bob[~stands], push[~stands], "x", color=VERMILION, label="falls: such a push is too weak")
    panel.set(xlabel="bob (kg)", ylabel="strongest push (N)", title="Swing-ups of a pendulum on a cart within 4 s")
    panel.legend(loc="upper left", frameon=True, framealpha=1.0)
    save_png(figure, output / "32_swing_ups_on_a_cluster.png", dpi=110)
    return angle


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
