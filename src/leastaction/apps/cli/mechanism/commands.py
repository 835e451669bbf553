"""The commands for any mechanism; what they need is imported when they run."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from leastaction.apps.cli.mechanism.options import ModelOptions, PoseOptions
from leastaction.apps.cli.options import OUTPUT
from leastaction.errors import ArgumentError

if TYPE_CHECKING:
    from leastaction.mechanics import Trajectory


def view(
    source: str,
    /,
    *,
    model: ModelOptions | None = None,
    pose: PoseOptions | None = None,
    out: Annotated[Path | None, Parameter(group=OUTPUT)] = None,
) -> int:
    """Look at a mechanism, or at a run that was saved, in the browser.

    Parameters
    ----------
    source
        A model: URDF, MJCF, YAML, or the name of a ready one; or a run: .h5, .npz.
    out
        File to write in place of opening the browser: .html, .png, .gif, .mp4 or .glb.
    """
    from leastaction.apps.cli.mechanism.source import MODEL_FILES, configuration_of, model_of
    from leastaction.viz import show

    if Path(source).suffix.lower() in MODEL_FILES or not Path(source).suffix:
        shown: Any = model_of(source, model)
        seen = show(shown, q=configuration_of(shown, pose))
    else:
        from leastaction.io import open as open_file

        seen = show(open_file(source))
    if out is None:
        seen.open()
    else:
        Console(highlight=False).print(f"written: {seen.save(out)}", markup=False, soft_wrap=True)
    return 0


def simulate(
    source: str,
    /,
    *,
    until: Annotated[float, Parameter(group=OUTPUT)] = 5.0,
    dt: Annotated[float, Parameter(group=OUTPUT)] = 0.005,
    input: Annotated[tuple[str, ...], Parameter(group=OUTPUT, negative=())] = (),  # noqa: A002
    model: ModelOptions | None = None,
    pose: PoseOptions | None = None,
    out: Annotated[Path | None, Parameter(group=OUTPUT)] = None,
    json_: Annotated[bool, Parameter(name="--json", group=OUTPUT, negative=())] = False,
) -> int:
    """Let a mechanism go from rest, and see what it does.

    Ctrl-C keeps what was made until then.

    Parameters
    ----------
    source
        A model: URDF, MJCF, YAML, or the name of a ready one.
    until
        Length, s.
    dt
        Time step, s.
    input
        Constant value of an input, such as push=1.5 (N or N m); may be given again. Zero if not given.
    out
        Folder for the run (run.h5, or run.npz without the extra data), its plots and an animation; nothing is written
        without it.
    json_
        Print what happened as JSON.
    """
    from leastaction.apps.cli.mechanism.simulation import simulated, times
    from leastaction.apps.cli.mechanism.source import configuration_of, model_of, numbers_by_name
    from leastaction.apps.cli.output import progress_bar
    from leastaction.apps.cli.shield import uninterrupted
    from leastaction.mechanics import SimulationStatus
    from leastaction.numerics.files import output_folder

    t = times(until, dt)
    chosen = model_of(source, model)
    m = chosen.mechanism
    inputs = numbers_by_name(input, m.inputs, "--input")
    q = configuration_of(chosen, pose)
    console = Console(highlight=False, stderr=json_)
    written: list[str] = []
    # The folder is looked at before the run, which may be a long one.
    with nullcontext() if out is None else output_folder(out) as folder:
        with progress_bar("simulating", len(t) - 1, console) as told:
            run = simulated(m, q, t, inputs, told)
        if folder is not None:
            with uninterrupted(), console.status("writing"):
                written = _write_run(run, chosen.shapes, folder)
    if json_:
        print(json.dumps(_facts(run) | {"written": written}))
    else:
        console.print(str(run), markup=False, soft_wrap=True)
        for name in written:
            console.print(f"written: {name}", markup=False, soft_wrap=True)
    if run.status is SimulationStatus.INTERRUPTED:
        return 130
    return 0 if run.status is SimulationStatus.COMPLETED else 1


def lqr(
    source: str,
    /,
    *,
    weight: Annotated[tuple[str, ...], Parameter(group=OUTPUT, negative=())] = (),
    effort: Annotated[tuple[str, ...], Parameter(group=OUTPUT, negative=())] = (),
    dt: Annotated[float | None, Parameter(group=OUTPUT)] = None,
    model: ModelOptions | None = None,
    pose: PoseOptions | None = None,
    json_: Annotated[bool, Parameter(name="--json", group=OUTPUT, negative=())] = False,
) -> int:
    """Find the feedback gains that hold a mechanism at rest, and the inputs that balance it there.

    Parameters
    ----------
    source
        A model: URDF, MJCF, YAML, or the name of a ready one.
    weight
        Price of the square of a variable, such as pole=10, or of its rate, pole.v=0.1; patterns work, and later ones
        count. 1 for variables and 0.1 for rates if not given.
    effort
        Price of the square of an input, such as push=0.01; 1 if not given.
    dt
        Steps over which a digital controller holds its inputs, s; gains in continuous time without it.
    json_
        Print the gains as JSON.
    """
    import numpy as np

    from leastaction.apps.cli.mechanism.rest import gain_table, linear_rest, regulator
    from leastaction.apps.cli.mechanism.source import configuration_of, model_of, numbers_by_name

    chosen = model_of(source, model)
    m = chosen.mechanism
    rates = [f"{name}.v" for name in m.dynamic]
    priced = dict.fromkeys(m.dynamic, 1.0) | dict.fromkeys(rates, 0.1)
    priced |= numbers_by_name([w for w in weight if not w.partition("=")[0].endswith(".v")], m.dynamic, "--weight")
    priced |= numbers_by_name([w for w in weight if w.partition("=")[0].endswith(".v")], rates, "--weight")
    efforts = dict.fromkeys(m.inputs, 1.0) | numbers_by_name(effort, m.inputs, "--effort")
    if dt is not None and not (np.isfinite(dt) and dt > 0.0):
        raise ArgumentError(f"--dt: got {dt:g} s, expected a time above zero")
    rest = linear_rest(m, configuration_of(chosen, pose))
    found = regulator(rest, np.array(list(priced.values())), np.array(list(efforts.values())), dt)
    states = [*m.dynamic, *rates]
    if json_:
        eigenvalues = [[float(value.real), float(value.imag)] for value in found.eigenvalues]
        print(json.dumps({
            "inputs": list(m.inputs), "states": states, "K": found.K.tolist(), "u": rest.u.tolist(),
            "q": m.named(rest.q), "dt": dt, "eigenvalues": eigenvalues,
        }))  # fmt: skip
        return 0
    console = Console(highlight=False)
    console.print(gain_table(found.K, rest.u, m.inputs, states, console.width))
    values = found.eigenvalues
    slowest = -values.real.max() if dt is None else -np.log(np.abs(values).max()) / dt
    held = "" if dt is None else f"inputs held over {dt:g} s; "
    end = f"{held}the slowest motion dies away at {slowest:.3g} 1/s"
    console.print(f"u = u_rest - K [q - q_rest; v]; {end}", markup=False, soft_wrap=True)
    return 0


def check(
    source: str,
    /,
    *,
    model: ModelOptions | None = None,
    pose: PoseOptions | None = None,
    json_: Annotated[bool, Parameter(name="--json", group=OUTPUT, negative=())] = False,
) -> int:
    """Check a mechanism before it is used: masses, inertias, loops, a pose at rest, derivatives.

    Ends with 1 where something wants a look.

    Parameters
    ----------
    source
        A model: URDF, MJCF, YAML, or the name of a ready one.
    json_
        Print what was found as JSON.
    """
    from leastaction.apps.cli.mechanism.checks import check_mechanism
    from leastaction.apps.cli.mechanism.source import configuration_of, left_out, model_of

    chosen = model_of(source, model)
    q = configuration_of(chosen, pose)
    report = check_mechanism(chosen.mechanism, q, name=source, left_out=tuple(left_out(chosen)))
    if json_:
        print(json.dumps(report.as_dict()))
    else:
        Console(highlight=False).print(report.table())
    return 0 if report.good else 1


def convert(source: Path, target: Path, /, *, model: ModelOptions | None = None) -> int:
    """Write a file in another format: a model as YAML, a run as a table, a capture as CSV.

    Parameters
    ----------
    source
        A model (URDF, MJCF, YAML), a run or result (.h5, .npz), or a motion (BVH, AMC, CSV).
    target
        File to write, by its ending: .yaml or .json of a model; .h5, .npz, .csv or .mat of a run; .csv of a motion.
    """
    from leastaction.apps.cli.mechanism.conversion import converted

    Console(highlight=False).print(f"written: {converted(source, target, model)}", markup=False, soft_wrap=True)
    return 0


def bench(
    source: str = "marionette",
    /,
    *,
    dt: float = 0.01,
    model: ModelOptions | None = None,
    pose: PoseOptions | None = None,
    json_: Annotated[bool, Parameter(name="--json", group=OUTPUT, negative=())] = False,
) -> int:
    """Measure how long a mechanism's steps and derivatives take on this machine, one thread.

    Parameters
    ----------
    source
        A model: URDF, MJCF, YAML, or the name of a ready one.
    dt
        Time step, s.
    json_
        Print the times as JSON (us).
    """
    from leastaction import _core
    from leastaction.apps.cli.mechanism.bench import timings
    from leastaction.apps.cli.mechanism.source import configuration_of, model_of

    if not 0.0 < dt < float("inf"):
        raise ArgumentError(f"--dt: got {dt:g} s, expected a time above zero")
    chosen = model_of(source, model)
    m = chosen.mechanism
    console = Console(highlight=False, stderr=json_)
    with console.status("measuring"):
        found = timings(m, configuration_of(chosen, pose), dt)
    if json_:
        print(json.dumps({"source": source, "core": _core.variant, "us": found}))
        return 0
    console.print(f"[bold]{source}[/bold]: variables {m.nv}, equations {m.nc}; core {_core.variant}")
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(justify="right")
    for name, value in found.items():
        table.add_row(f"{value:.2f} us", name)
    console.print(table)
    return 0


def _write_run(run: Trajectory, shapes: Any, folder: Path) -> list[str]:
    """Write a run with its pictures into a folder; return the files."""
    from importlib.util import find_spec

    from leastaction.viz import plot_energy, plot_run, save_png, show

    kept = [run.save(folder / ("run.h5" if find_spec("h5py") else "run.npz"))]
    if not run.steps:
        return [str(file) for file in kept]  # the first step could not be made, so that there is no motion to draw
    kept.append(show(run, shapes=shapes).save(folder / "motion.html"))
    if find_spec("matplotlib"):
        kept += [save_png(plot_run(run), folder / "states.png"), save_png(plot_energy(run), folder / "energy.png")]
    return [str(file) for file in kept]


def _facts(run: Trajectory) -> dict[str, Any]:
    """Return what happened in a run as plain data."""
    energy = run.energy().total if run.steps else []
    return {
        "status": run.status.name,
        "message": run.message,
        "steps": run.steps,
        "t": [float(run.t[0]), float(run.t[-1])],
        "last": run.mechanism.named(run.q[-1]),
        "energy": [float(energy[0]), float(energy[-1])] if len(energy) else [],
    }
