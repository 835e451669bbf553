"""The numbers of a run that a person wants to see, as data and as tables."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction.apps.marionette.check import check
from leastaction.apps.marionette.markers import MARKERS
from leastaction.apps.marionette.resting import RestingPoses
from leastaction.apps.marionette.scene import GROUPS, string_label, string_lengths
from leastaction.apps.marionette.speeds import AtSpeed
from leastaction.apps.marionette.tracking import Effort, PuppetLimits, TrackingRun
from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal import Status
from leastaction.viz import TrackingErrors

_WIDTH: Final = 100
_FAR: Final = 5.0  # degrees (rms), from which a joint is said not to be followed
_MOST_LINES: Final = 8
_FIRM: Final = 2.0  # N, with which strings stay taut on a rig whose readings are off by a milliradian
_KINDS: Final = {
    "tension": "tensions of the strings",
    "joints": "angles of the joints",
    "reach": "reach of the strings' ends",
    "speed": "speed of the strings' ends",
    "acceleration": "acceleration of the strings' ends",
}

# The optimiser speaks of its arguments, the command line of its options.
_MESSAGES: Final = {
    Status.ITERATION_LIMIT: ("The limit on iterations was reached: raise --max-iterations, or go on with --resume."),
    Status.INTERRUPTED: "Interrupted; this is the last whole iterate. Go on with --resume.",
    Status.STOPPED_BY_CALLBACK: "The run was cut off; this was kept on the way. Go on with --resume.",
}


def run_summary(run: TrackingRun, rest: RestingPoses | None = None) -> dict[str, Any]:
    """Return the numbers of a run as plain data for JSON.

    ``rest``: what strings can hold at rest, if that is to be told. Returns ``run``, ``settings``, ``versions``,
    ``cost``, ``tracking`` (errors in degrees and metres) and ``strings``.
    """
    result, t = run.result, run.trajectory.t
    far, against = _not_followed(run)
    cost, effort = result.history.cost, run.effort or Effort().plus(result)
    first = float(cost[0]) if np.isnan(effort.first_cost) else effort.first_cost
    return {
        "run": {
            "mechanism": "marionette",
            "status": result.status.name,
            "message": _MESSAGES.get(result.status, result.message),
            "created": run.provenance.created,
            "steps": len(t) - 1,
            "duration_s": float(t[-1] - t[0]),
            "iterations": effort.iterations,
            "optimisations": effort.optimisations,
            "last_iterations": result.iterations,
        },
        "settings": {
            "source": run.source,
            "dt": float(t[1] - t[0]),
            **asdict(result.settings),
            "embedded": run.embedded,
        },
        "versions": dict(run.provenance.versions),
        "cost": {"first": first, "last": float(cost[-1])},
        "follows": run.follow,
        "tracking": _tracking(run.errors),
        "markers": {} if run.markers is None else _markers(run, rest),
        "not_followed": far,
        "limits_reached": against,
        "limits_broken": [] if run.limits is None else _broken(run, run.limits),
        "held_joints": {"rms_deg": run.held_error}
        | ({} if rest is None or run.follow == "markers" else {"at_rest_rms_deg": rest.error}),
        "strings": {
            name: _string(run.tension[:, i], string_lengths(run)[:, i])
            for i, name in enumerate(run.mechanism.constraints)
        },
    }


def _not_followed(run: TrackingRun) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the joints that are far from the reference, and the limits that hold the motion back, most first."""
    t, names = run.trajectory.t, run.mechanism.dynamic
    apart = np.rad2deg(np.abs(run.reference[:, : len(names)] - run.trajectory.q[:, : len(names)]))
    far: list[dict[str, Any]] = [
        {
            "joint": name,
            "rms_deg": float(rms),
            "max_deg": float(apart[:, i].max()),
            "at_s": float(t[apart[:, i].argmax()]),
        }
        for i, (name, unit, rms) in enumerate(zip(names, run.errors.units, run.errors.rms, strict=True))
        if unit == "deg" and rms > _FAR and run.follow == "joints"
    ]
    limits = run.result.limits
    against: list[dict[str, Any]] = [
        {
            "limit": label,
            "unit": _unit_of(label),
            "share_percent": 100.0 * float(side.active[:, j].mean()),
            "at_s": float(t[side.k[worst]]),
        }
        for side in (() if limits is None else limits.sides)
        for j, label in enumerate(side.labels)
        if side.active[:, j].any()
        for worst in [int(np.abs(side.dual[:, j]).argmax())]
    ]
    far.sort(key=lambda entry: entry["rms_deg"], reverse=True)
    against.sort(key=lambda entry: entry["share_percent"], reverse=True)
    return far, against


def _unit_of(label: str) -> str:
    """Return the unit of a limit by its label, which begins with what is limited."""
    for begins, unit in (("v_", "m/s"), ("acceleration of ", "m/s²"), ("tension of ", "N")):
        if label.startswith(begins):
            return unit
    name = label.split(maxsplit=1)[0]
    if name.endswith(("-x", "-y")):
        return "m"
    return "N" if name.endswith("_string") else "rad"


def _broken(run: TrackingRun, limits: PuppetLimits) -> list[str]:
    """Return the kinds of limits that a motion breaks which ended before they were stated."""
    kinds = limits.broken(run.mechanism, run.trajectory.t, run.reference[:, :2], run.result.x)
    if run.tension.min() < 0.0:
        kinds |= {"tension"}
    return [said for kind, said in _KINDS.items() if kind in kinds - run.kinds]


def _tracking(errors: TrackingErrors) -> dict[str, Any]:
    """Errors of the dynamic variables."""
    columns = zip(errors.names, errors.units, errors.rms, errors.largest, strict=True)
    variables: dict[str, dict[str, Any]] = {
        name: {"unit": unit, "rms": float(rms), "max": float(largest)} for name, unit, rms, largest in columns
    }
    return {
        "joint_rms_deg": errors.joint_rms,
        "joint_max_deg": max(v["max"] for v in variables.values() if v["unit"] == "deg"),
        "variables": variables,
    }


def _markers(run: TrackingRun, rest: RestingPoses | None) -> dict[str, Any]:
    """Errors of the markers (mm)."""
    apart, t = 1e3 * run.markers_apart(), run.trajectory.t
    at_rest = {} if rest is None or np.isnan(rest.markers) else {"at_rest_rms_mm": 1e3 * rest.markers}
    return {
        "rms_mm": float(np.sqrt(np.mean(apart**2))),
        **at_rest,
        "each": {
            name: {
                "rms_mm": float(np.sqrt(np.mean(apart[:, i] ** 2))),
                "max_mm": float(apart[:, i].max()),
                "at_s": float(t[apart[:, i].argmax()]),
            }
            for i, name in enumerate(MARKERS)
        },
    }


def _string(pull: Array, length: Array) -> dict[str, float]:
    """Tension and length of one string."""
    return {
        "tension_min_N": float(pull.min()),
        "tension_mean_N": float(pull.mean()),
        "tension_max_N": float(pull.max()),
        "slack_percent": 100.0 * float(np.mean(pull < 0.0)),
        "length_min_m": float(length.min()),
        "length_max_m": float(length.max()),
    }


def summary_tables(summary: Mapping[str, Any]) -> RenderableType:
    """Return the summary of a run, as `run_summary` makes it, as tables for a terminal."""
    lines, markers = _not_followed_lines(summary), summary["markers"]
    return Group(
        _headline(summary),
        "",
        *([lines, ""] if lines else []),
        *([_marker_table(markers), ""] if markers else []),
        _tracking_table(summary["tracking"]),
        "",
        _string_table(summary["strings"]),
    )


def speed_table(tried: Sequence[AtSpeed], goal: float) -> RenderableType:
    """Return the errors at all speeds that were tried, the fastest first, as a table for a terminal."""
    what, unit = ("markers", " mm") if tried[0].run.follow == "markers" else ("held joints", "°")
    table = _table("speed", what, "status", left=1)
    for each in sorted(tried, key=lambda one: -one.speed):
        met = Text(f"{each.error:.2f}{unit}", style="" if each.error <= goal else "red")
        table.add_row(f"{each.speed:g}", met, each.run.result.status.name)
    least = min(each.error for each in tried)
    title = f"Error over speed: at most {goal:g}{unit} rms asked for"
    return _titled(title if least <= goal else f"{title}, at none of these speeds", table)


def checked(run: TrackingRun) -> str:
    """Return a line on what a rig makes of a run, for a terminal."""
    try:
        found = check(run)
    except LeastActionError as error:
        return f"The run cannot be played on a rig: {error}"
    more = "" if found.passed or found.played.failure is not None else ": more than twice as much"
    least = float(run.tension.min())
    if not found.passed and least < _FIRM:
        # Half a newton is a quarter of a millimetre of such strings, which a noisy reading is off by too.
        more += (
            f". Strings planned with {least:.2g} N go slack and taut from step to step there: "
            f"plan with a higher least tension (--tension {_FIRM:g})"
        )
    return f"O{str(found)[1:]}{more}"


def as_text(renderable: RenderableType) -> str:
    """Return what a terminal would show, as plain text."""
    stream = io.StringIO()
    Console(file=stream, width=_WIDTH, color_system=None, force_terminal=False).print(renderable)
    lines = stream.getvalue().splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _headline(summary: Mapping[str, Any]) -> Text:
    run, cost = summary["run"], summary["cost"]
    many = run["optimisations"]
    # What strings would do for less is not allowed to them: a motion that has limits to meet yet may be the cheaper.
    at_first = f"{cost['first']:.6g}{' before limits were met' if cost['first'] < cost['last'] else ''}"
    stages = f" of {many} optimisations, {run['last_iterations']} of the last one" if many > 1 else ""
    return Text.assemble(
        (f"{run['mechanism']}: {run['steps']} steps, {run['duration_s']:g} s", "bold"),
        f"\nstatus {run['status']} after {run['iterations']} iterations{stages}, "
        f"cost {at_first} to {cost['last']:.6g}\n{run['message']}",
    )


def _not_followed_lines(summary: Mapping[str, Any]) -> RenderableType | None:
    """Return what could not be followed, and what stood against it; None where there is nothing to say."""
    far, against = summary["not_followed"][:_MOST_LINES], summary["limits_reached"][:_MOST_LINES]
    held, broken = summary["held_joints"], summary["limits_broken"]
    if not far and not against and not broken and "at_rest_rms_deg" not in held:
        return None
    table = Table(box=None, pad_edge=False, show_header=False)
    if "at_rest_rms_deg" in held:
        row = f"{held['rms_deg']:.1f}° rms as made, {held['at_rest_rms_deg']:.1f}° in poses at rest"
        table.add_row(Text("Off", style="dim"), "held joints", row)
    for i, entry in enumerate(far):
        row = f"{entry['rms_deg']:.1f}° rms, at most {entry['max_deg']:.1f}° at {entry['at_s']:.2f} s"
        table.add_row(Text("Not followed" if i == 0 else "", style="dim"), entry["joint"], row)
    for i, entry in enumerate(against):
        row = f"{entry['share_percent']:.0f} % of the time, hardest at {entry['at_s']:.2f} s"
        limit = f"{entry['limit']} {entry['unit']}"
        table.add_row(Text("Limits reached" if i == 0 else "", style="dim"), limit, row)
    for i, kind in enumerate(broken):
        table.add_row(Text("Limits broken" if i == 0 else "", style="dim"), kind, "")
    return table


def _titled(title: str, table: Table) -> RenderableType:
    """Put a title over a table; rich's own titles wrap at the width of the table."""
    return Group(Text(title, style="bold"), table)


def _table(*columns: str, left: int = 1) -> Table:
    """Return an empty table, the numbers in whose columns are set flush right."""
    table = Table(box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i < left else "right")
    return table


def _tracking_table(tracking: Mapping[str, Any]) -> RenderableType:
    table = _table("", "joint", "rms", "max", left=2)
    for heading, names in GROUPS.items():
        for i, name in enumerate(names):
            entry = tracking["variables"][name]
            show = "{:.2f}°".format if entry["unit"] == "deg" else _millimetres
            label = Text(heading if i == 0 else "", style="dim")
            table.add_row(label, name, show(entry["rms"]), show(entry["max"]))
    title = (
        f"Tracking error: rms {tracking['joint_rms_deg']:.2f}° over all joint angles, "
        f"at most {tracking['joint_max_deg']:.2f}°"
    )
    return _titled(title, table)


def _marker_table(markers: Mapping[str, Any]) -> RenderableType:
    table = _table("marker", "rms", "max", "at")
    for name, entry in markers["each"].items():
        far = f"{entry['rms_mm']:.1f} mm", f"{entry['max_mm']:.1f} mm", f"{entry['at_s']:.2f} s"
        table.add_row(name.replace("_", " "), *far)
    at_rest = f", {markers['at_rest_rms_mm']:.1f} mm in poses at rest" if "at_rest_rms_mm" in markers else ""
    return _titled(f"Markers: rms {markers['rms_mm']:.1f} mm{at_rest}", table)


def _string_table(strings: Mapping[str, Any]) -> RenderableType:
    table = _table("string", "tension min", "mean", "max", "slack", "length min", "max")
    for name, entry in strings.items():
        slack = entry["slack_percent"]
        table.add_row(
            string_label(name),
            *(f"{entry[f'tension_{kind}_N']:z.1f} N" for kind in ("min", "mean", "max")),
            Text(f"{slack:.1f} %", style="red") if slack > 0.0 else Text("never"),
            *(f"{entry[f'length_{kind}_m']:.3f} m" for kind in ("min", "max")),
        )
    return _titled("Strings", table)


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.1f} mm"
