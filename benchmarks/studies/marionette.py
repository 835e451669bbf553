"""The marionette follows a motion that was simulated, in both kinds of time, and one that was not.

Dissertation 6.7.3. First it is wanted to move as it did in a simulation, of which only the configurations are kept:
from strings that are held, from strings that are forces at first, and in continuous time. Then a motion that no puppet
made: a walk on the spot that stands for a captured one, or a BVH file of yours, under strings that only pull; in
discrete time, and from there a window of it in continuous time.

    python -m benchmarks.studies.marionette --out pictures --motion walk.bvh --strings 9
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
    Bound,
    ContinuousQuadraticCost,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    QuadraticCost,
    Trajectory,
    by_tensions,
    optimize,
)
from leastaction.models.marionette import STRING_SETS, UNHELD, Count, marionette, rest_pose, set_of
from leastaction.optimal import (
    Accuracy,
    ContinuousOptimizationResult,
    ContinuousProjection,
    DenseTrajectory,
    PiecewisePolynomial,
)
from leastaction.viz import plot_snapshots
from leastaction.viz.figures import BLUE, ORANGE, styled
from leastaction_marionette import FORCED, GENTLE, TrackingRun, load_motion, marionette_scene, track, walk_in_place

T = np.linspace(0.0, 5.0, 501)
SHORT = 0.5  # of continuous time (s)
BODY, REST = 100.0, 0.01  # weights: of the puppet's own variables, and of everything else
ELBOW = "relbow_rx"
WINDOW = (0.0, 1.5)  # of a captured motion in continuous time (s); its last part, if it is shorter
LEAST = 0.5  # tension of each string (N)
ROUGHLY = Accuracy(rtol=2e-3)  # of the mesh: what is found is integrated again with a millionth


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
        x, _ = self.continuous.dense.sample(T[T <= SHORT])
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


def follow_captured(file: Path | None, strings: Count = 6) -> TrackingRun:
    """Follow a captured motion, or the made-up walk, with strings that only pull."""
    motion = walk_in_place(5.0) if file is None else load_motion(file).motion
    return track(marionette(strings=strings), motion)


@dataclass(frozen=True)
class Window:
    """A part of a captured motion in continuous time: times (s) of the discrete instants in it, and what was found."""

    mechanism: Mechanism
    t: np.ndarray
    start: int
    run: TrackingRun
    result: ContinuousOptimizationResult
    seconds: float

    @property
    def q(self) -> np.ndarray:
        """Configurations of the puppet at the instants."""
        return self.result.dense.sample(self.t)[0][:, : self.run.mechanism.nd]

    @property
    def off(self) -> tuple[float, float]:
        """How far joints are from the wanted motion, in continuous and in discrete time (degrees, rms)."""
        there, joints = slice(self.start, self.start + len(self.t)), slice(3, self.run.mechanism.nd)
        wanted = self.run.reference[there, joints]
        found = self.q[:, 3:] - wanted, self.run.trajectory.q[there, joints] - wanted
        return tuple(float(np.degrees(np.sqrt(np.mean(each**2)))) for each in found)

    @property
    def apart(self) -> float:
        """How far joints in both kinds of time are from each other (degrees, rms)."""
        q = self.run.trajectory.q[self.start : self.start + len(self.t), 3 : self.run.mechanism.nd]
        return float(np.degrees(np.sqrt(np.mean((self.q[:, 3:] - q) ** 2))))

    @property
    def tension(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (s) of the points of the mesh, and tensions of the strings there (N)."""
        side = self.result.limits.sides[0]
        return side.t, side.value + LEAST

    def integrated(self) -> float:
        """Return how far joints are off where the found inputs and gains are integrated accurately (degrees)."""
        system = MechanismSystem(self.mechanism)
        again = ContinuousProjection(system, self.result.feedback, accuracy=Accuracy(rtol=1e-7, atol=1e-9))(
            self.result.dense
        )
        if again.trajectory is None:
            return np.inf
        q = again.trajectory.sample(self.t)[0][:, : self.run.mechanism.nd]
        return float(np.degrees(np.abs(q - self.q)[:, 3:].max()))


def window_of(times: np.ndarray, window: tuple[float, float]) -> tuple[int, int]:
    """Return the first and the last instant of a window, or of the last part as long as it of a shorter motion."""
    length = window[1] - window[0]
    begin = max(min(window[0], times[-1] - length), times[0])
    return tuple(int(np.argmin(np.abs(times - t))) for t in (begin, begin + length))


def follow_continuously(run: TrackingRun, window: tuple[float, float]) -> Window:
    """Follow a part of a captured motion in continuous time, with the weights and the limit of the discrete run.

    The strings are forces, with the same motions, and with bounds on inputs in the place of limits that the whole
    motion takes part in. It begins with the discrete optimum: its configurations as a function of time, with the
    velocities and accelerations of that, and its tensions.
    """
    m, w = marionette(strings=set_of(run.mechanism), by="tension"), FORCED if run.embedded else GENTLE
    columns = [run.mechanism.variables.index(name) for name in m.variables]
    times = run.trajectory.t
    first, last = window_of(times, window)
    t = times[first : last + 1]
    found, wanted = CubicSpline(times, run.trajectory.q[:, columns]), CubicSpline(times, run.reference[:, columns])
    pulls = run.tension[first : last + 1]
    free = UNHELD if len(m.inputs) < 8 else ()
    held = np.array([w.unheld if name in free else 1.0 for name in m.dynamic])
    body = np.array([w.root if name.startswith("torso_t") else w.joint for name in m.dynamic])
    cost = ContinuousQuadraticCost(
        PiecewisePolynomial.through(t, np.hstack([wanted(t), wanted(t, 1)[:, : m.nd], np.zeros((len(t), m.nrho))])),
        np.r_[pulls.mean(axis=0), np.zeros(m.nrho)],
        Q=np.r_[held * body, np.full(m.nrho, w.string), held * w.rate, np.full(m.nrho, 1e-9)],
        R=np.r_[np.full(len(m.inputs), w.tension), np.full(m.nrho, w.string_acceleration)],
    )
    begun = time.process_time()
    result = optimize(
        MechanismSystem(m),
        cost,
        initial=DenseTrajectory.from_samples(
            t, np.hstack([found(t), found(t, 1)]), np.hstack([pulls, found(t, 2)[:, m.nd :]])
        ),
        limits=[Bound(m.inputs, min=LEAST, of="input")],
        accuracy=ROUGHLY,
        tolerance=1e-4,
    )
    return Window(m, t, first, run, result, time.process_time() - begun)


@dataclass(frozen=True)
class Result:
    """Both parts of the example."""

    simulated: Simulated
    captured: TrackingRun
    window: Window


@styled
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
    elbow.plot(t, np.degrees(run.trajectory.q[:, i]), color=BLUE, lw=1.2, label="discrete")
    part = result.window
    elbow.plot(part.t, np.degrees(part.q[:, i]), color=ORANGE, lw=2.4, alpha=0.7, label="continuous")
    elbow.set(xlabel="time (s)", ylabel=f"{ELBOW} (degrees)", xlim=(t[0], t[-1]), title=run.source)
    elbow.margins(y=0.15)
    elbow.legend(frameon=False, fontsize=8, ncols=3, loc="upper center")
    for name, tension in zip(run.mechanism.constraints, run.tension[1:].T, strict=True):
        pulls.plot(t[1:-1], tension, lw=1.0, label=name.removesuffix("_string").replace("_", " "))
    # Alternate points of a mesh are rough where a string is at its least: what is drawn is that at the ends of pieces.
    when, tension = part.tension
    for one in tension[::3].T:
        pulls.plot(when[::3], one, "k--", lw=0.6)
    pulls.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    pulls.set_yscale("symlog", linthresh=1.0)
    pulls.set(xlabel="time (s)", ylabel="tension of its strings (N)", xlim=(t[0], t[-1]))
    pulls.set_ylim(min(-0.2, run.tension.min()), 2.0 * run.tension.max())
    pulls.legend(frameon=False, fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(output: Path, motion: Path | None = None, strings: Count = 6) -> Result:
    """Follow both motions, print and draw."""
    part = follow_simulated()
    for (name, off), one in zip(part.followed.items(), (part.held, part.forces, part.continuous), strict=True):
        print(f"{name:13} {one.status.name} in {one.iterations} iterations, {part.seconds[name]:.1f} s, "
              f"joints off by {off:.2g} degrees rms, cost {one.cost:.9g}")  # fmt: skip
    run = follow_captured(motion, strings)
    print(f"{run.source}: {run.result.status.name} in {run.result.iterations} iterations, joints off by "
          f"{run.errors.joint_rms:.2g} degrees rms, least tension {run.tension.min():.2f} N")  # fmt: skip
    window = follow_continuously(run, WINDOW)
    found, discrete = window.off
    print(f"continuous, {window.t[0]:.2f} to {window.t[-1]:.2f} s: {window.result.status.name} in "
          f"{window.result.iterations} iterations, {window.seconds:.0f} s, {len(window.result.t) - 1} pieces, joints "
          f"off by {found:.2g} degrees rms (discrete {discrete:.2g}), {window.apart:.2g} from discrete time, least "
          f"tension {window.tension[1].min():.2f} N; integrated {window.integrated():.2g} degrees off")  # fmt: skip
    result = Result(part, run, window)
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "marionette.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("output"))
    parser.add_argument("--motion", type=Path, help="a BVH file; the made-up walk if left out")
    parser.add_argument("--strings", type=int, choices=list(STRING_SETS), default=6, help="how many; 6 if left out")
    given = parser.parse_args()
    main(given.out, given.motion, given.strings)
