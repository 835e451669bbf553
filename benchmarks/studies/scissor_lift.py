"""A scissor lift that hangs and swings: many closed loops, one degree of freedom (dissertation 5.1).

The lift of `leastaction.models.scissor_lift` is simulated with all its links and pins. The Lagrangian of its one
degree of freedom, derived by SymPy and integrated at 1e-12, is the reference: how far off are 0.01 s steps, what
does an error of 0.1 rad^2 s over 15 s take by the number of segments, and what damping is found from a motion.

    python -m benchmarks.studies.scissor_lift --out pictures
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp, trapezoid
from scipy.interpolate import CubicSpline

from leastaction import MidpointVI, Trajectory
from leastaction.errors import CoarseStepWarning, EnergyBalanceWarning
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction.viz.figures import BLUE, GREEN, INK, ORANGE, VERMILION, styled

try:
    import mujoco
except ImportError:  # it is shown beside where it is installed
    mujoco = None
try:
    import ode  # of the Open Dynamics Engine: Debian's package python3-pyode, for the system's Python
except ImportError:
    ode = None

LENGTH, MASS, SLIDER, GRAVITY = 1.0, 1.0, 0.5, 9.8
INERTIA = MASS * LENGTH**2 / 12.0
START = 0.6  # angle of the links below the level (rad)
DT = 0.01
SEGMENTS = (1, 2, 3, 5, 8)
# The experiment that tells of damping.
DAMPING, OFFSET, AMPLITUDE, OMEGA = 0.2, 120.0, 40.0, 1.5  # N m s/rad, N, N, rad/s
MEASURED, NOISE = 5, 0.02  # every so many steps; rad


def push(t: np.ndarray | float) -> np.ndarray | float:
    """Return the force on the slider in the experiment (N)."""
    return OFFSET + AMPLITUDE * np.sin(OMEGA * t)


def reference(
    segments: int,
    t: np.ndarray,
    angle: float = START,
    damping: float = 0.0,
    force: Callable[[float], float] | None = None,
) -> np.ndarray:
    """Return the angle of the links (rad) by the equation of motion of the one degree of freedom."""
    a, w = sympy.symbols("a w")
    middles = [(LENGTH / 2 * sympy.cos(a), (n + sympy.Rational(1, 2)) * LENGTH * sympy.sin(a)) for n in range(segments)]
    slope = [(sympy.diff(x, a), sympy.diff(z, a)) for x, z in middles]
    inertia = sum(2 * (MASS * (x**2 + z**2) + INERTIA) for x, z in slope) + SLIDER * (LENGTH * sympy.sin(a)) ** 2
    lagrangian = inertia * w**2 / 2 + sum(2 * MASS * GRAVITY * z for _, z in middles)
    # Two joints turn at w, the others, two between segments, at 2 w.
    drag = damping * (2 + 8 * (segments - 1)) * w
    rest = sympy.diff(lagrangian, a) - sympy.diff(lagrangian, w, a) * w - drag
    accelerate = sympy.lambdify([a, w], [rest / inertia, -LENGTH * sympy.sin(a) / inertia], "math", cse=True)

    def rate(moment: float, y: np.ndarray) -> list[float]:
        free, by_force = accelerate(*y)
        return [y[1], free if force is None else free + by_force * force(moment)]

    out = solve_ivp(rate, (t[0], t[-1]), [angle, 0.0], t_eval=t, method="DOP853", rtol=1e-12, atol=1e-12)
    return out.y[0]


def swing(segments: int, t: np.ndarray) -> Trajectory:
    """Return the lift let go at the start's angle."""
    vi = MidpointVI(scissor_lift(segments, slider_mass=SLIDER))
    with warnings.catch_warnings():
        # The longest steps that are tried go over the upright lift, where its equations are close to singular.
        # There they lose some of their energy, as their errors tell too.
        warnings.simplefilter("ignore", CoarseStepWarning)
        warnings.simplefilter("ignore", EnergyBalanceWarning)
        return vi.simulate(vi.start(*at_angle(vi.mechanism, START)), t)


def mujoco_swing(segments: int, t: np.ndarray) -> np.ndarray:
    """Return the angle of the first link by MuJoCo, with its pins as constraints of its default softness."""

    def link(side: str, n: int, pos: str) -> str:
        below = link("R" if side == "L" else "L", n + 1, f"{LENGTH} 0 0") if n + 1 < segments else ""
        return (
            f'<body pos="{pos}"><joint name="{side}{n}" type="hinge" axis="0 1 0"/>'
            f'<inertial mass="{MASS}" pos="{LENGTH / 2} 0 0" diaginertia="1e-9 {INERTIA} {INERTIA}"/>'
            f'<site name="{side}{n}" pos="{LENGTH / 2} 0 0"/>{below}</body>'
        )

    pins = "".join(f'<connect site1="L{n}" site2="R{n}"/>' for n in range(segments))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" balanceinertia="true"/><option timestep="{t[1]}" gravity="0 0 {-GRAVITY}"/>'
        f'<worldbody>{link("L", 0, "0 0 0")}<body><joint name="slider" type="slide" axis="1 0 0"/>'
        f'<inertial mass="{SLIDER}" pos="0 0 0" diaginertia="1e-6 1e-6 1e-6"/>{link("R", 0, "0 0 0")}</body>'
        f"</worldbody><equality>{pins}</equality></mujoco>"
    )
    lift, data, angles = scissor_lift(segments), mujoco.MjData(model), [START]
    q, _ = at_angle(lift, START)
    for name, value in zip(lift.variables, q, strict=True):
        data.joint(name).qpos[0] = value
    for _ in t[1:]:
        mujoco.mj_step(model, data)
        angles.append(data.joint("L0").qpos[0])
    return np.array(angles)


def ode_swing(segments: int, t: np.ndarray) -> np.ndarray:
    """Return the angle of the first link by the Open Dynamics Engine, with its joints as they are by default."""
    world = ode.World()
    world.setGravity((0.0, 0.0, -GRAVITY))
    wide, deep = LENGTH * np.cos(START), LENGTH * np.sin(START)

    def body(x: float, z: float, mass: float, inertia: float) -> ode.Body:
        made, about = ode.Body(world), ode.Mass()
        about.setParameters(mass, 0.0, 0.0, 0.0, inertia, inertia, inertia, 0.0, 0.0, 0.0)
        made.setMass(about)
        made.setPosition((x, 0.0, z))
        return made

    pins = []

    def pin(one: ode.Body, other: ode.Body, x: float, z: float) -> None:
        pins.append(ode.HingeJoint(world))
        pins[-1].attach(one, other)
        pins[-1].setAnchor((x, 0.0, z))
        pins[-1].setAxis((0.0, 1.0, 0.0))

    slider, rail = body(wide, 0.0, SLIDER, 1e-6), ode.SliderJoint(world)
    rail.attach(slider, ode.environment)
    rail.setAxis((1.0, 0.0, 0.0))
    left, right = ode.environment, slider  # what holds the upper ends
    for n in range(segments):
        down, up = (body(0.5 * wide, -(n + 0.5) * deep, MASS, INERTIA) for _ in range(2))
        pin(down, left, 0.0, -n * deep)
        pin(up, right, wide, -n * deep)
        pin(down, up, 0.5 * wide, -(n + 0.5) * deep)
        left, right = up, down
    angles = [START]
    for dt in np.diff(t):
        world.step(float(dt))
        angles.append(START + pins[0].getAngle())
    return np.unwrap(angles)


def passages(t: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return the times (s) at which the links come up to upright."""
    x = angle - 0.5 * np.pi
    up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    return t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])


def endurance(seconds: float = 1000.0) -> tuple[int, float, float]:
    """Return the swings of a long run, how late it is after them (s), and by how much its amplitude changed (rad)."""
    run = swing(5, DT * np.arange(round(seconds / DT) + 1))
    seen, known = passages(run.t, run["L0"]), passages(run.t[:4001], reference(5, run.t[:4001]))
    swings, period = len(seen) - 1, (known[-1] - known[0]) / (len(known) - 1)
    last = run["L0"][-round(2.0 * period / DT) :]
    return swings, float(seen[-1] - seen[0] - swings * period), float(np.ptp(last) - (np.pi - 2.0 * START)) / 2.0


@dataclass(frozen=True)
class Effort:
    """The step at which the lift of so many segments is off by 0.1 rad^2 s after 15 s, and what a run with it takes."""

    segments: int
    dt: float
    seconds: float


def effort(segments: int, seconds: float = 15.0, allowed: float = 0.1) -> Effort:
    """Find the longest step for an error: the integral of the square of the angle's, (5.1)."""
    fine = np.linspace(0.0, seconds, 6001)
    exact = CubicSpline(fine, reference(segments, fine))

    def error(steps: int) -> float:
        t = np.linspace(0.0, seconds, steps + 1)
        run = swing(segments, t)
        return np.inf if run.steps < steps else float(trapezoid((run["L0"] - exact(t)) ** 2, t))

    few, many = 100, 200
    while error(many) > allowed:
        few, many = many, 2 * many
    while many - few > 0.02 * many:
        middle = (few + many) // 2
        few, many = (middle, many) if error(middle) > allowed else (few, middle)
    t = np.linspace(0.0, seconds, many + 1)
    took = []
    for _ in range(3):
        begun = time.process_time()
        swing(segments, t)
        took.append(time.process_time() - begun)
    return Effort(segments, seconds / many, min(took))


class Experiment:
    """A lift with damping, drawn aside and pushed to and fro at its slider; its angle is measured with noise."""

    def __init__(self, seconds: float = 12.0) -> None:
        self.t = DT * np.arange(round(seconds / DT) + 1)
        exact = reference(5, self.t[::MEASURED], 1.2, DAMPING, push)
        self.measured = exact + NOISE * np.random.default_rng(2012).standard_normal(exact.shape)
        self.lift = scissor_lift(5, slider_mass=SLIDER, damping=1.0)
        self.names = [name for name in self.lift.parameters if name.startswith("damping.")]

    def simulate(self, damping: float, t: np.ndarray | None = None) -> Trajectory:
        """Return the motion with another damping."""
        times = self.t if t is None else t
        vi = MidpointVI(self.lift.with_parameters(dict.fromkeys(self.names, damping)))
        start = vi.start(*at_angle(vi.mechanism, 1.2))
        return vi.simulate(start, times, inputs=push(0.5 * (times[1:] + times[:-1])))

    def identify(self, guess: float = 0.6) -> tuple[list[float], float]:
        """Return the damping after each Gauss-Newton step, and its standard error, from exact derivatives."""
        found = [guess]
        for _ in range(8):
            run = self.simulate(found[-1])
            by = (
                MidpointVI(run.mechanism)
                .sensitivity(run, self.names)
                .x[::MEASURED, run.mechanism.variables.index("L0")]
            )
            slope = by.sum(axis=1)  # one damping in all joints
            found.append(found[-1] + float(slope @ (self.measured - run["L0"][::MEASURED]) / (slope @ slope)))
        return found, NOISE / float(np.sqrt(slope @ slope))

    def amplitude(self, damping: float) -> float:
        """Return the amplitude of the steady state (rad): half of what the last of many periods spans."""
        t = DT * np.arange(6001)
        return 0.5 * float(np.ptp(self.simulate(damping, t)["L0"][t > t[-1] - 2.0 * np.pi / OMEGA]))


@dataclass(frozen=True)
class Result:
    """What the figure shows."""

    t: np.ndarray
    exact: np.ndarray
    run: Trajectory
    seconds: float  # of the run
    others: dict[tuple[str, float], np.ndarray]  # another engine's angle, by its name and time step
    efforts: list[Effort]
    damping: list[float]  # by the steps of the fit
    error: float
    dampings: np.ndarray
    amplitudes: np.ndarray


def solve() -> Result:
    """Simulate, compare and identify."""
    t = DT * np.arange(1001)
    begun = time.process_time()
    run = swing(5, t)
    seconds = time.process_time() - begun
    engines = (("MuJoCo", mujoco, mujoco_swing), ("ODE", ode, ode_swing))
    others = {
        (name, dt): swings(5, dt * np.arange(round(10.0 / dt) + 1))
        for name, engine, swings in engines
        if engine is not None
        for dt in (1e-2, 1e-3)
    }
    experiment = Experiment()
    damping, error = experiment.identify()
    dampings = np.linspace(0.1, 1.0, 10)
    amplitudes = np.array([experiment.amplitude(c) for c in dampings])
    return Result(
        t, reference(5, t), run, seconds, others, [effort(n) for n in SEGMENTS], damping, error, dampings, amplitudes
    )


@styled
def draw(result: Result) -> Figure:
    """Return the figure: the swing, its error, the effort by segments, and what tells of damping."""
    figure = Figure(figsize=(11.5, 7.4), layout="constrained")
    (angle, error), (by_segments, amplitude) = figure.subplots(2, 2)
    colors = {"MuJoCo": (ORANGE, VERMILION), "ODE": (GREEN, INK)}
    for (name, dt), values in result.others.items():
        t, color = dt * np.arange(len(values)), colors[name][dt < DT]
        angle.plot(t, np.degrees(values), color=color, lw=1, label=f"{name}, steps of {1e3 * dt:g} ms")
    angle.plot(result.t, np.degrees(result.exact), color="0.6", lw=4, label="reference")
    angle.plot(result.t, np.degrees(result.run["L0"]), color=BLUE, lw=1, label="midpoint, steps of 10 ms")
    angle.set(xlabel="time (s)", ylabel="angle of the links (degrees)", xlim=(0.0, 5.0), ylim=(-20.0, 180.0))
    angle.set_title("five segments, let go")
    angle.legend(fontsize=8, loc="lower center", ncols=2)
    error.plot(result.t, np.degrees(result.run["L0"] - result.exact), color=BLUE, lw=1)
    error.set(xlabel="time (s)", ylabel="off by (degrees)", title="midpoint less reference", xlim=(0.0, 10.0))
    n = [one.segments for one in result.efforts]
    by_segments.loglog(n, [1e3 * one.seconds for one in result.efforts], "o-", label="time (ms)")
    by_segments.loglog(n, [1e3 * one.dt for one in result.efforts], "s--", color="0.4", label="time step (ms)")
    by_segments.set(xlabel="segments", xticks=n, xticklabels=n, title=r"15 s to an error of 0.1 rad$^2$ s")
    by_segments.minorticks_off()
    by_segments.legend(frameon=False)
    amplitude.plot(result.dampings, np.degrees(result.amplitudes), "o-", ms=4, color=GREEN)
    true = np.interp(DAMPING, result.dampings, np.degrees(result.amplitudes))
    amplitude.axhspan(0.99 * true, 1.01 * true, color=GREEN, alpha=0.15, lw=0, label="within 1 % of the amplitude")
    wide = result.damping[-1] + 2.0 * result.error * np.array([-1.0, 1.0])
    amplitude.axvspan(*wide, color=BLUE, alpha=0.5, lw=0, label="fit of the motion, twice its error")
    amplitude.set(xlabel="damping (N m s/rad)", ylabel="amplitude (degrees)", ylim=(0.95 * true, 1.05 * true))
    amplitude.set_title("what tells of damping")
    amplitude.legend(fontsize=8, loc="lower right")
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    off = np.degrees(np.abs(result.run["L0"] - result.exact).max())
    print(
        f"10 s of five segments at 10 ms: off by {off:.2f} degrees, in {1e3 * result.seconds:.0f} ms "
        "(dissertation: 1.74 s)"
    )
    swings, late, grown = endurance()
    print(f"after 1000 s and {swings} swings it is {late:+.2f} s late, its amplitude {grown:+.0e} rad off")
    for (name, dt), values in result.others.items():
        top = np.degrees(values[len(values) // 2 :].max())
        print(f"{name} at {1e3 * dt:g} ms: after 5 s up to {top:.0f} instead of {180 - np.degrees(START):.0f} degrees")
    for one in result.efforts:
        print(
            f"{one.segments:2} segments: steps of {1e3 * one.dt:5.2f} ms for the error, "
            f"{1e3 * one.seconds:6.1f} ms for 15 s"
        )
    print(
        f"damping {result.damping[-1]:.4f} +- {result.error:.4f} from the motion; truth {DAMPING} (dissertation: 0.2)"
    )
    true = np.interp(DAMPING, result.dampings, result.amplitudes)
    differs = 100.0 * np.abs(result.amplitudes / true - 1.0).max()
    least, most = result.dampings[[0, -1]]
    print(f"dampings from {least:g} to {most:g} change the amplitude by {differs:.1f} % at most")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "scissor_lift.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
