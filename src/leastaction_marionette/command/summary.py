"""The numbers of a run that a person wants to see, as data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np

from leastaction.models.marionette import bars_of
from leastaction.numerics import Array
from leastaction.optimal import Status
from leastaction.viz import TrackingErrors
from leastaction_marionette.at_rest import RestingPoses
from leastaction_marionette.markers import MARKERS
from leastaction_marionette.scene import by_parts, own_string_lengths
from leastaction_marionette.tracking import PuppetLimits, TrackingRun
from leastaction_marionette.tracking.limits import pelvis_of
from leastaction_marionette.turns import differences

_FAR: Final = 5.0  # degrees (rms), from which a joint is said not to be followed
_KINDS: Final = {
    "tension": "tensions of the strings",
    "joints": "angles of the joints",
    "reach": "reach of the strings' ends",
    "speed": "speed of the strings' ends",
    "acceleration": "acceleration of the strings' ends",
}
_OF_BARS: Final = {
    "reach": "reach of the strings' ends, or lift and tilt of bars",
    "speed": "speed of the strings' ends, or of bars",
    "acceleration": "acceleration of the strings' ends, or of bars",
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
    ``cost``, ``tracking`` (errors in degrees and metres), ``strings`` and ``bars``.
    """
    result, t = run.result, run.trajectory.t
    far, against = _not_followed(run)
    lengths = own_string_lengths(run)
    cost, effort = result.history.cost, run.effort
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
        "tracking": _tracking(run.errors) | {"parts": by_parts(run.mechanism)},
        "markers": {} if run.markers is None else _markers(run, rest),
        "not_followed": far,
        "limits_reached": against,
        "limits_broken": _broken(run, run.limits),
        "held_joints": {"rms_deg": run.held_error}
        | ({} if rest is None or run.follow == "markers" else {"at_rest_rms_deg": rest.error}),
        "strings": {
            name: _string(run.tension[:, i], lengths[:, i]) for i, name in enumerate(run.mechanism.constraints)
        },
        "bars": _bars(run),
    }


def _not_followed(run: TrackingRun) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the joints that are far from the reference, and the limits that hold the motion back, most first."""
    t, names = run.trajectory.t, run.mechanism.dynamic
    apart = np.rad2deg(np.abs(differences(run.mechanism, run.trajectory.q, run.reference)[:, : len(names)]))
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
            "limit": label.removesuffix(f" {unit}"),
            "unit": unit,
            "share_percent": 100.0 * float(side.active[:, j].mean()),
            "at_s": float(t[side.k[worst]]),
        }
        for side in (() if limits is None else limits.sides)
        for j, label in enumerate(side.labels)
        if side.active[:, j].any()
        for worst, unit in [(int(np.abs(side.dual[:, j]).argmax()), _unit_of(label))]
    ]
    far.sort(key=lambda entry: entry["rms_deg"], reverse=True)
    against.sort(key=lambda entry: entry["share_percent"], reverse=True)
    return far, against


def _unit_of(label: str) -> str:
    """Return the unit of a limit by its label, which begins with what is limited."""
    if label.startswith("tension of "):
        return "N"
    begins = next((each for each in ("v_", "acceleration of ") if label.startswith(each)), "")
    name = label.removeprefix(begins).split(maxsplit=1)[0]
    unit = "m" if name.endswith(("-x", "-y", "-z")) else "N" if name.endswith("_string") else "rad"
    return unit + {"": "", "v_": "/s", "acceleration of ": "/s²"}[begins]


_CLEARLY = 0.02  # of a limit, by which it is clearly broken


def _broken(run: TrackingRun, limits: PuppetLimits) -> list[str]:
    """Return the kinds of limits that a motion clearly breaks."""
    made = run.mechanism, run.trajectory.t, pelvis_of(run.mechanism, run.reference), run.result.x
    kinds = limits.loosened(_CLEARLY).broken(*made)
    if run.tension.min() < 0.0:
        kinds |= {"tension"}
    said = _KINDS | (_OF_BARS if bars_of(run.mechanism) else {})
    return [said[kind] for kind in said if kind in kinds]


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


def _bars(run: TrackingRun) -> dict[str, dict[str, dict[str, float | str]]]:
    """How bars are moved: each of their variables from its least to its largest value, and its largest speed."""
    dt = float(run.trajectory.t[1] - run.trajectory.t[0])
    found: dict[str, dict[str, dict[str, float | str]]] = {}
    for bar in bars_of(run.mechanism):
        found[bar.name] = {}
        for name in bar.variables:
            place, unit = run.trajectory[name], "m"
            if name in bar.angles:
                place, unit = np.rad2deg(place), "deg"
            found[bar.name][name.removeprefix(f"{bar.name}-")] = {
                "unit": unit,
                "min": float(place.min()),
                "max": float(place.max()),
                "max_speed": float(np.abs(np.diff(place)).max()) / dt,
            }
    return found
