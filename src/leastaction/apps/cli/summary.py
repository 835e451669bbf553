"""The numbers of a run that a person wants to see, as data and as tables."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from leastaction.io.results.record import RunRecord
from leastaction.viz.tracking import tracking_errors

_WIDTH = 100


def run_summary(record: RunRecord, *, string_lengths: np.ndarray | None = None) -> dict[str, Any]:
    """Return the numbers of a run as plain data for JSON.

    Parameters
    ----------
    record
        The run.
    string_lengths
        Lengths of the strings, (N+1, nc), m, where the constraints are strings.

    Returns
    -------
    dict
        ``run``, ``cost``, ``tracking`` (errors in degrees and metres), ``strings`` and ``versions``.
    """
    cost = np.atleast_1d(record.histories.get("cost", np.zeros(0)))
    summary: dict[str, Any] = {
        "run": {
            "mechanism": record.mechanism,
            "status": record.status,
            "message": record.message,
            "created": record.created,
            "steps": len(record.t) - 1,
            "duration_s": float(record.t[-1] - record.t[0]),
            "iterations": max(0, cost.size - 1),
        },
        "settings": dict(record.settings),
        "versions": dict(record.versions),
    }
    if cost.size:
        summary["cost"] = {"first": float(cost[0]), "last": float(cost[-1])}
    if record.q_wanted is not None:
        summary["tracking"] = _tracking(record)
    if record.tension is not None:
        summary["strings"] = _strings(record, string_lengths)
    return summary


def _tracking(record: RunRecord) -> dict[str, Any]:
    """Errors of the dynamic variables."""
    assert record.q_wanted is not None
    nd = record.n_dynamic
    names = record.variables[:nd]
    errors = tracking_errors(
        record.q_wanted[:, :nd], record.q[:, :nd], names, lengths=length_names(names)
    )
    return {
        "joint_rms_deg": errors.joint_rms,
        "joint_max_deg": max(
            (
                float(large)
                for large, unit in zip(errors.largest, errors.units, strict=True)
                if unit == "deg"
            ),
            default=0.0,
        ),
        "variables": {
            name: {"unit": unit, "rms": float(rms), "max": float(largest)}
            for name, unit, rms, largest in zip(
                errors.names, errors.units, errors.rms, errors.largest, strict=True
            )
        },
    }


def _strings(record: RunRecord, lengths: np.ndarray | None) -> dict[str, Any]:
    """Tension and length of each string."""
    assert record.tension is not None
    result: dict[str, Any] = {}
    for i, name in enumerate(record.constraints):
        pull = record.tension[:, i]
        result[name] = {
            "tension_min_N": float(pull.min()),
            "tension_mean_N": float(pull.mean()),
            "tension_max_N": float(pull.max()),
            "slack_percent": 100.0 * float(np.mean(pull < 0.0)),
        }
        if lengths is not None:
            result[name] |= {
                "length_min_m": float(lengths[:, i].min()),
                "length_max_m": float(lengths[:, i].max()),
            }
    return result


def length_names(names: Sequence[str]) -> list[str]:
    """Return the names of variables that are lengths, by the ending that says so."""
    return [name for name in names if name.endswith(("_tx", "_ty", "_tz"))]


def summary_tables(
    summary: Mapping[str, Any], *, groups: Mapping[str, Sequence[str]] | None = None
) -> RenderableType:
    """Return the summary as tables for a terminal.

    Parameters
    ----------
    summary
        From `run_summary`.
    groups
        Headings and variables of the tracking table; one group without a heading if not given.
    """
    parts: list[RenderableType] = [_headline(summary)]
    if tracking := summary.get("tracking"):
        parts += ["", _tracking_table(tracking, groups or {"": list(tracking["variables"])})]
    if strings := summary.get("strings"):
        parts += ["", _string_table(strings)]
    return Group(*parts)


def as_text(renderable: RenderableType) -> str:
    """Return what a terminal would show, as plain text."""
    stream = io.StringIO()
    Console(file=stream, width=_WIDTH, color_system=None, force_terminal=False).print(renderable)
    lines = stream.getvalue().splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _headline(summary: Mapping[str, Any]) -> Text:
    run = summary["run"]
    text = Text()
    text.append(f"{run['mechanism']}: {run['steps']} steps, {run['duration_s']:g} s", style="bold")
    text.append(f"\nstatus {run['status']} after {run['iterations']} iterations")
    if cost := summary.get("cost"):
        text.append(f", cost {cost['first']:.6g} to {cost['last']:.6g}")
    if run["message"]:
        text.append(f"\n{run['message']}")
    return text


def _titled(title: str, table: Table) -> RenderableType:
    """Put a title over a table; rich's own titles wrap at the width of the table."""
    return Group(Text(title, style="bold"), table)


def _tracking_table(
    tracking: Mapping[str, Any], groups: Mapping[str, Sequence[str]]
) -> RenderableType:
    title = (
        f"Tracking error: rms {tracking['joint_rms_deg']:.2f}° over all joint angles, "
        f"at most {tracking['joint_max_deg']:.2f}°"
    )
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    table.add_column("joint")
    table.add_column("rms", justify="right")
    table.add_column("max", justify="right")
    variables = tracking["variables"]
    for heading, names in groups.items():
        for i, name in enumerate(name for name in names if name in variables):
            entry = variables[name]
            show = _degrees if entry["unit"] == "deg" else _millimetres
            label = Text(heading if i == 0 else "", style="dim")
            table.add_row(label, name, show(entry["rms"]), show(entry["max"]))
    return _titled(title, table)


def _string_table(strings: Mapping[str, Any]) -> RenderableType:
    table = Table(box=None, pad_edge=False)
    table.add_column("string")
    for name in ("tension min", "mean", "max", "slack", "length min", "max"):
        table.add_column(name, justify="right")
    for name, entry in strings.items():
        slack = entry["slack_percent"]
        table.add_row(
            name.removesuffix("_string").replace("_", " "),
            f"{entry['tension_min_N']:.1f} N",
            f"{entry['tension_mean_N']:.1f} N",
            f"{entry['tension_max_N']:.1f} N",
            Text(f"{slack:.1f} %", style="red") if slack > 0.0 else Text("never"),
            f"{entry['length_min_m']:.3f} m" if "length_min_m" in entry else "",
            f"{entry['length_max_m']:.3f} m" if "length_max_m" in entry else "",
        )
    return _titled("Strings", table)


def _degrees(value: float) -> str:
    return f"{value:.2f}°"


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.1f} mm"
