"""Draws docs/images/gaps.png, how the gaps of a curve close: python docs/images/draw_gaps.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import (
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    ty,
    tz,
)
from leastaction.optimal import IterationRecord
from leastaction.viz import BLUE, VERMILION, new_figure, save_png, styled

N = 30
mechanism = Mechanism(
    [ty("cart", mass=1.0), [rx("pole"), [tz(-1.0, mass=1.0)]]], [Gravity(), JointForce("cart", input="push")]
)
system = MidpointSystem(MidpointVI(mechanism), np.linspace(0.0, 1.5, N + 1))
x, u = np.zeros((N + 1, 4)), np.zeros((N, 1))
x[:, 1] = np.linspace(0.0, np.pi, N + 1)
wanted = np.zeros((N + 1, 4))
wanted[:, 1] = np.pi
cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[0.1, 0.1, 0.0, 0.0], R=[1e-3], Q_final=[100.0, 100.0, 10.0, 10.0])
records: list[IterationRecord] = []
optimize(system, cost, initial=(x, u), shooting="multiple", callback=records.append)



@styled
def draw() -> Figure:
    """Return the curve at the start, on the way and at the end, each with what its steps lead to."""
    figure = new_figure(8.0, 2.9)
    axes = figure.subplots(1, 3, sharey=True)
    for axis, record in zip(axes, (records[0], records[2], records[-1]), strict=True):
        ends = system.step_each(record.x, record.u).x
        for k in range(N):
            axis.plot(system.t[k : k + 2], [record.x[k, 1], ends[k, 1]], color=BLUE, linewidth=1.5)
            axis.plot([system.t[k + 1]] * 2, [ends[k, 1], record.x[k + 1, 1]], color=VERMILION, linewidth=1.5)
        axis.plot(system.t, record.x[:, 1], ".", color="black", markersize=4, label="states")
        axis.plot([], color=BLUE, label="steps from them")
        axis.plot([], color=VERMILION, label="gaps")
        axis.set(title="the start" if record.iteration == 0 else f"after {record.iteration} iterations")
        axis.set_xlabel("time (s)")
    axes[0].set_ylabel("angle of the pole (rad)")
    axes[0].legend()
    return figure


save_png(draw(), Path(__file__).with_name("gaps.png"), dpi=110.0)
