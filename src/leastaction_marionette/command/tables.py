"""The numbers of a run as tables for a terminal, and as plain text."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction.errors import LeastActionError
from leastaction_marionette.on_a_rig import check
from leastaction_marionette.scene import string_label
from leastaction_marionette.speeds import AtSpeed
from leastaction_marionette.tracking import TrackingRun

_WIDTH: Final = 100
_MOST_LINES: Final = 8
_FIRM: Final = 2.0  # N, with which strings stay taut on a rig whose readings are off by a milliradian
_VIOLENT, _GENTLER = 200.0, 150.0  # N, of pulls that rigs lose, and of a most tension that may be held


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
        *(["", _bar_table(summary["bars"])] if summary["bars"] else []),
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
    if not found.passed and (most := float(run.tension.max())) > _VIOLENT:
        more += f". Strings planned with up to {most:.0f} N swing there: plan with less (--strength {_GENTLER:g})"
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
        share = f"{entry['share_percent']:.0f}" if entry["share_percent"] >= 1.0 else "under 1"
        row = f"{share} % of the time, hardest at {entry['at_s']:.2f} s"
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
    for heading, names in tracking["parts"].items():
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


def _bar_table(bars: Mapping[str, Any]) -> RenderableType:
    table = _table("bar", "", "min", "max", "fastest", left=2)
    moves = {"x": "right", "y": "ahead", "z": "up", "rz": "turned left", "ry": "tilted right", "rx": "tilted back"}
    for bar, variables in bars.items():
        for i, (name, entry) in enumerate(variables.items()):
            unit, digits = ("°", 1) if entry["unit"] == "deg" else (" m", 3)
            ends = (f"{entry[end]:z.{digits}f}{unit}" for end in ("min", "max"))
            label = Text(bar if i == 0 else "", style="dim")
            table.add_row(label, moves[name], *ends, f"{entry['max_speed']:.{digits}f}{unit}/s")
    return _titled("Bars", table)


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.1f} mm"
