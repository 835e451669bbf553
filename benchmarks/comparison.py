"""Error, energy and constraint drift against time spent: the midpoint rule, classical solvers, MuJoCo.

``python -m benchmarks.comparison [--quick] [--only NAME]`` measures, draws docs/images/comparison_*.png and prints the
tables of docs/comparison.md.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from benchmarks.cases import Array  # noqa: E402
from benchmarks.comparison_problems import PROBLEMS, Problem  # noqa: E402
from leastaction.mechanics import Distance, MidpointVI  # noqa: E402
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics  # noqa: E402
from leastaction.mechanics.continuous.legendre import to_momentum  # noqa: E402
from leastaction.mechanics.continuous.simulation import simulate  # noqa: E402
from leastaction.viz import new_figure, save_png, styled  # noqa: E402
from leastaction.viz.figures import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, VERMILION  # noqa: E402

IMAGES = Path(__file__).parents[1] / "docs" / "images"
REPEATS = 3
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, INK, GREY)
LOST = 1e3
"""(rad or m) beyond which a motion counts as lost."""
SAMPLES = 20
"""Instants at which runs are compared."""


@dataclass(frozen=True)
class Point:
    """One run: what it took, and how far it was off at the worst."""

    method: str
    setting: str
    seconds: float
    error: float
    energy: float
    drift: float
    momentum: float


@dataclass(frozen=True)
class Motion:
    """Configurations and velocities at the samples; energies and momenta where the run has its own."""

    q: Array
    v: Array
    energy: Array | None = None
    momentum: Array | None = None


def measure(problem: Problem, quick: bool) -> list[Point]:
    """Return the runs of all methods."""
    reference = problem.reference(problem.samples(SAMPLES))
    points = []
    for method, setting, run in _runs(problem, quick):
        best = np.inf
        for _ in range(1 if quick else REPEATS):
            seconds, motion = run(problem)
            best = min(best, seconds)
        momentum = 0.0 if problem.free is None else _momentum(problem.free, run(problem.free)[1])
        error, energy, drift = _judged(problem, motion, reference)
        points.append(Point(method, setting, best, error, energy, drift, momentum))
        print(f"{problem.name:16} {method:24} {setting:12} {_row(points[-1])}", file=sys.stderr)
    return points


def _judged(problem: Problem, motion: Motion, reference: Array) -> tuple[float, float, float]:
    """Return the largest error, change of energy and residual of a constraint; infinite where the motion is lost."""
    m = problem.mechanism
    if not np.all(np.abs(motion.q) < LOST):
        return np.inf, np.inf, np.inf
    error = float(np.abs(motion.q - reference)[:, : m.nd].max())
    energy = motion.energy
    if energy is None:
        energy = m.energy(motion.q, motion.v).total
    change = float(np.abs(energy - energy[0]).max()) / problem.energy_scale
    return error, change, float(np.abs(m.constraint_values(motion.q)).max(initial=0.0))


def _momentum(free: Problem, motion: Motion) -> float:
    """Return the largest change of the momentum of the first variable, relative to it."""
    p = motion.momentum
    if p is None:
        p = to_momentum(free.mechanism, motion.q, motion.v)[:, 0]
    return float(np.abs(p - p[0]).max() / abs(p[0]))


def _runs(problem: Problem, quick: bool) -> Iterator[tuple[str, str, Callable[[Problem], tuple[float, Motion]]]]:
    steps = [problem.steps * 2**k for k in range(2 if quick else 6)]
    for n in steps:
        yield "midpoint VI", f"{n} steps", lambda p, n=n: _midpoint(p, n)
    for n in steps:
        yield "RK4", f"{n} steps", lambda p, n=n: _runge_kutta(p, n)
    for method in ("DOP853", "Radau"):
        for rtol in (1e-3, 1e-5) if quick else (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10):
            if method == "Radau" and rtol < 1e-8:
                continue
            yield method, f"rtol {rtol:g}", lambda p, s=method, r=rtol: _scipy(p, s, r)
    try:
        import mujoco
    except ImportError:
        print("mujoco is not installed: its rows are left out", file=sys.stderr)
        return
    for integrator in ("Euler", "implicitfast", "RK4"):
        for n in steps:
            yield (
                f"MuJoCo {integrator}",
                f"{n} steps",
                lambda p, n=n, i=integrator: _mujoco(mujoco, p, i, n),
            )


def _midpoint(problem: Problem, steps: int) -> tuple[float, Motion]:
    m = problem.mechanism
    vi = MidpointVI(m, threads=1)
    start = vi.start(problem.q0, problem.v0)
    t = np.linspace(0.0, problem.end, steps + 1)
    begin = time.process_time()
    run = vi.simulate(start, t)
    seconds = time.process_time() - begin
    at = np.linspace(0, steps, SAMPLES + 1).round().astype(int)
    q = np.full((SAMPLES + 1, m.nq), np.nan)
    q[at <= run.steps] = run.q[at[at <= run.steps]]
    return seconds, Motion(q, np.zeros_like(q), run.energy().total, run.p[:, 0])


def _runge_kutta(problem: Problem, steps: int) -> tuple[float, Motion]:
    """The classical method on the bare equations: nothing brings it back onto the constraints."""
    m = problem.mechanism
    core = ContinuousDynamics(m, threads=1).core
    u, none = np.zeros((1, m.nu)), np.zeros((1, m.nrho))
    nq, nd, dt = m.nq, m.nd, problem.end / steps

    def rate(x: Array) -> Array:
        result = np.zeros(2 * nq)
        result[:nq] = x[nq:]
        result[nq : nq + nd] = core.accelerations(x[None, :nq], x[None, nq:], u, none, 1).a[0]
        return result

    x = np.concatenate([problem.q0, problem.v0])
    kept, every = [x], steps // SAMPLES
    begin = time.process_time()
    for k in range(steps):
        k1 = rate(x)
        k2 = rate(x + 0.5 * dt * k1)
        k3 = rate(x + 0.5 * dt * k2)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(x + dt * k3))
        if (k + 1) % every == 0:
            kept.append(x)
    seconds = time.process_time() - begin
    states = np.array(kept)
    return seconds, Motion(states[:, :nq], states[:, nq:])


def _scipy(problem: Problem, method: str, rtol: float) -> tuple[float, Motion]:
    """With every step projected onto the constraints."""
    t = problem.samples(SAMPLES)
    begin = time.process_time()
    run = simulate(
        problem.mechanism, problem.q0, problem.v0, t, method=method, rtol=rtol, atol=rtol, dense_output=False
    )  # fmt: skip
    seconds = time.process_time() - begin
    if len(run.t) < len(t):
        raise RuntimeError(run.message)
    return seconds, Motion(run.q, run.v)


def _mujoco(mujoco: Any, problem: Problem, integrator: str, steps: int) -> tuple[float, Motion]:
    model = mujoco.MjModel.from_xml_string(problem.mjcf(integrator, problem.end / steps))
    data = mujoco.MjData(model)
    m = problem.mechanism
    strings = [e.length for e in m.elements.values() if isinstance(e, Distance)]
    if strings:
        # MuJoCo holds a tendon at so much more than its length in the zero configuration.
        lengths = [problem.q0[m.variables.index(name)] for name in strings]
        model.eq_data[:, 0] = lengths - model.tendon_length0
    ids = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in m.dynamic]
    places, speeds = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
    data.qpos[places], data.qvel[speeds] = problem.q0[: m.nd], problem.v0[: m.nd]
    q, v = np.tile(problem.q0, (SAMPLES + 1, 1)), np.zeros((SAMPLES + 1, m.nq))
    v[0] = problem.v0
    seconds = 0.0
    for k in range(SAMPLES):
        begin = time.process_time()
        mujoco.mj_step(model, data, nstep=steps // SAMPLES)
        seconds += time.process_time() - begin
        q[k + 1, : m.nd], v[k + 1, : m.nd] = data.qpos[places], data.qvel[speeds]
    return seconds, Motion(q, v)


# Pictures and tables


@styled
def draw(problem: Problem, points: list[Point]) -> Figure:
    """Return error, energy and drift against time."""
    panels = [
        ("error", f"largest error ({problem.unit})"),
        ("energy", "energy lost or gained (relative)"),
    ]
    if problem.free is not None:
        panels.append(("momentum", "momentum lost or gained (relative)"))
    if problem.mechanism.nc:
        panels.append(("drift", f"constraints off by ({problem.drift_unit})"))
    figure = new_figure(3.2 * len(panels), 3.6)
    for axes, (field, label) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        for i, method in enumerate(dict.fromkeys(p.method for p in points)):
            mine = [p for p in points if p.method == method]
            y = np.array([getattr(p, field) for p in mine])
            # What is zero belongs on the picture too; a motion that is lost leaves a gap.
            y = np.where(np.isfinite(y), np.maximum(y, 1e-17), np.nan)
            style = "--" if "MuJoCo" in method else "-"
            axes.loglog(
                [1e3 * p.seconds for p in mine], y, style, marker="osD^vPX"[i], ms=4, label=method, color=COLOURS[i]
            )  # fmt: skip
        axes.set_xlabel("time spent (ms)")
        axes.set_ylabel(label)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=7, fontsize=8)
    figure.suptitle(f"{problem.title}, {problem.end:g} s", fontsize=11)
    return figure


def table(points: list[Point]) -> str:
    """Return the runs as a table in Markdown."""
    lines = [
        "| method | setting | ms | error | energy | constraints | momentum |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [f"| {p.method} | {p.setting} | {_row(p, ' | ')} |" for p in points]
    return "\n".join(lines)


def _row(p: Point, between: str = "  ") -> str:
    values = (p.error, p.energy, p.drift, p.momentum)
    shown = ["lost" if np.isinf(v) else f"{v:.1e}" if v else "-" for v in values]
    return between.join([f"{1e3 * p.seconds:.3g}", *shown])


def main() -> int:
    """Measure, draw and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.comparison")
    parser.add_argument("--quick", action="store_true", help="few settings, one run each")
    parser.add_argument("--only", action="append", choices=sorted(PROBLEMS), metavar="NAME")
    parser.add_argument("--images", type=Path, default=IMAGES, help="where the pictures go")
    arguments = parser.parse_args()
    for name in arguments.only or PROBLEMS:
        problem = PROBLEMS[name]()
        points = measure(problem, arguments.quick)
        arguments.images.mkdir(parents=True, exist_ok=True)
        save_png(draw(problem, points), arguments.images / f"comparison_{name}.png", dpi=110)
        print(f"\n### {problem.title}\n\n{table(points)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
