"""The marionette follows a motion that was simulated, in both kinds of time, and one that was not.

Dissertation 6.7.3. First it is wanted to move as it did in a simulation, of which only the configurations are kept:
from strings that are held, from strings that are forces at first, and in continuous time. Then a motion that no puppet
made: a walk on the spot that stands for a captured one, or a BVH file of yours, under strings that only pull.

    python examples/18_marionette.py --out pictures --motion walk.bvh
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from leastaction import (
    ContinuousQuadraticCost,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    QuadraticCost,
    Trajectory,
    by_tensions,
    optimize,
)
from leastaction.apps.marionette import TrackingRun, load_motion, marionette_scene, track, walk_in_place
from leastaction.models.marionette import marionette, rest_pose
from leastaction.optimal import ContinuousOptimizationResult
from leastaction.viz import plot_snapshots

T = np.linspace(0.0, 5.0, 501)
SHORT = 0.5  # of continuous time (s)
BODY, REST = 100.0, 0.01  # weights: of the puppet's own variables, and of everything else
ELBOW = "relbow_rx"


def simulated(vi: MidpointVI) -> tuple[Trajectory, Trajectory]:
    """Return the wanted motion, in which arms and legs are raised by turns, and one whose strings are held."""
    m = vi.mechanism
    start = vi.start(rest_pose(m))
    rho = np.tile(start.q[m.nd :], (len(T), 1))
    for string, sign in (("right_leg", 1.0), ("left_arm", 1.0), ("left_leg", -1.0), ("right_arm", -1.0)):
        rho[:, m.kinematic.index(f"{string}_string-length")] += sign * 0.1 * np.sin(2.0 * np.pi * 0.3 * T)
    return vi.simulate(start, T, rho=rho), vi.simulate(start, T)


@dataclass(frozen=True)
class Simulated:
    """The wanted motion of the simulation, and what follows it; seconds that each took, by its name."""

    wanted: Trajectory
    held: OptimizationResult
    forces: OptimizationResult
    continuous: ContinuousOptimizationResult
    seconds: dict[str, float]

    def off(self, q: np.ndarray) -> float:
        """Return how far configurations from the first instant on are from the wanted ones (degrees, rms)."""
        joints = slice(3, self.wanted.mechanism.nd)
        return float(np.degrees(np.sqrt(np.mean((q - self.wanted.q[: len(q)])[:, joints] ** 2))))

    @property
    def followed(self) -> dict[str, float]:
        """How far each is off (degrees, rms)."""
        nq = self.wanted.mechanism.nq
        x, _ = self.continuous.trajectory.sample(T[T <= SHORT])
        return {
            "held strings": self.off(self.held.x[:, :nq]),
            "forces first": self.off(self.forces.x[:, :nq]),
            "continuous": self.off(x[:, :nq]),
        }


def follow_simulated() -> Simulated:
    """Follow the simulated motion, of which only the configurations are kept."""
    m = marionette()
    vi = MidpointVI(m)
    wanted, held = simulated(vi)
    x_wanted = np.hstack([wanted.q, np.zeros((len(T), m.nx - m.nq))])
    Q, R = np.where(np.arange(m.nx) < m.nd, BODY, REST), np.full(m.nrho, REST)
    system = MidpointSystem(vi, T)
    cost = QuadraticCost(x_wanted, np.zeros((len(T) - 1, m.nrho)), Q=Q, R=R)
    begun = [time.process_time()]
    from_held = optimize(system, cost, initial=(held.x, held.u))
    begun.append(time.process_time())
    from_forces = by_tensions(system, cost, initial=(held.x, held.u), price=1e-6).result
    begun.append(time.process_time())
    # In continuous time the state is [q; rho; v; v_rho], and the inputs are the accelerations of rho.
    smooth = CubicSpline(T, wanted.q)
    other = ContinuousQuadraticCost(
        lambda t: np.r_[smooth(t), np.zeros(m.nx - m.nq)], np.zeros(m.nrho), Q=Q, R=R
    )  # fmt: skip
    start = np.r_[wanted.q[0], np.zeros(m.nx - m.nq)]
    continuous = optimize(
        MechanismSystem(m), other, initial=(start, np.zeros(m.nrho)), horizon=(0.0, SHORT), tolerance=1e-4
    )
    begun.append(time.process_time())
    names = "held strings", "forces first", "continuous"
    return Simulated(wanted, from_held, from_forces, continuous, dict(zip(names, np.diff(begun), strict=True)))


def follow_captured(file: Path | None) -> TrackingRun:
    """Follow a captured motion, or the made-up walk, with strings that only pull."""
    motion = walk_in_place(5.0) if file is None else load_motion(file).motion
    return track(marionette(), motion)


@dataclass(frozen=True)
class Result:
    """Both parts of the example."""

    simulated: Simulated
    captured: TrackingRun


def draw(result: Result) -> Figure:
    """Return the figure: the puppet on its motion, convergence, an elbow, and the tensions."""
    figure = Figure(figsize=(12.0, 8.4), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.25, 1.0])
    poses = plot_snapshots(marionette_scene(result.captured), count=7)
    poses.set_dpi(220)
    canvas = FigureCanvasAgg(poses)
    canvas.draw()
    axis = above.subplots()
    axis.imshow(np.asarray(canvas.buffer_rgba()), interpolation="antialiased")
    axis.set_axis_off()
    convergence, elbow, pulls = below.subplots(1, 3)
    part, run = result.simulated, result.captured
    for name, one in (("held strings", part.held), ("forces first", part.forces), ("continuous", part.continuous)):
        costs = np.asarray(one.history.cost)
        convergence.semilogy((costs - costs[-1])[:-1], "o-", ms=4, lw=1.2, label=name)
    convergence.set(xlabel="iteration", ylabel="cost above its last value", title="simulated motion")
    convergence.legend(frameon=False)
    t, i = run.trajectory.t, run.mechanism.variables.index(ELBOW)
    elbow.plot(t, np.degrees(run.reference[:, i]), "k:", label="wanted")
    elbow.plot(t, np.degrees(run.trajectory.q[:, i]), color="tab:blue", lw=1.2, label="found")
    elbow.set(xlabel="time (s)", ylabel=f"{ELBOW} (degrees)", xlim=(t[0], t[-1]), title=run.source)
    elbow.legend(frameon=False)
    for name, tension in zip(run.mechanism.constraints, run.tension[1:].T, strict=True):
        pulls.plot(t[1:-1], tension, lw=1.0, label=name.removesuffix("_string").replace("_", " "))
    pulls.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    pulls.set_yscale("symlog", linthresh=1.0)
    pulls.set(xlabel="time (s)", ylabel="tension of its strings (N)", xlim=(t[0], t[-1]))
    pulls.set_ylim(min(-0.2, run.tension.min()), 2.0 * run.tension.max())
    pulls.legend(frameon=False, fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(output: Path, motion: Path | None = None) -> Result:
    """Follow both motions, print and draw."""
    part = follow_simulated()
    for (name, off), one in zip(part.followed.items(), (part.held, part.forces, part.continuous), strict=True):
        print(f"{name:13} {one.status.name} in {one.iterations} iterations, {part.seconds[name]:.1f} s, "
              f"joints off by {off:.2g} degrees rms, cost {one.cost:.9g}")  # fmt: skip
    run = follow_captured(motion)
    print(f"{run.source}: {run.result.status.name} in {run.result.iterations} iterations, joints off by "
          f"{run.errors.joint_rms:.2g} degrees rms, least tension {run.tension.min():.2f} N")  # fmt: skip
    result = Result(part, run)
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "18_marionette.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    parser.add_argument("--motion", type=Path, help="a BVH file; the made-up walk if left out")
    given = parser.parse_args()
    main(given.out, given.motion)
