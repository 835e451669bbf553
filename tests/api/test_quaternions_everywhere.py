"""All that takes a mechanism takes one whose rotations are quaternions."""

from __future__ import annotations

import importlib
import inspect
import warnings
from pathlib import Path
from typing import Any

import pytest

from api import rotating
from leastaction.control.bridge import gymnasium, jax, python_control, torch
from leastaction.mechanics import Mechanism, MidpointVI, Trajectory

CASES = {"carried by a hand": rotating.Case(rotating.carried), "floating": rotating.Case(rotating.floating)}
GROUPS = {
    "mechanism": rotating.mechanism_calls, "optimal": rotating.optimal_calls, "drawn": rotating.drawing_calls,
}  # fmt: skip

TAKEN_BY = (
    "Mechanism", "MidpointVI", "MidpointSystem", "MechanismSystem", "DiscreteSystem", "ContinuousDynamics",
    "Trajectory", "ContinuousTrajectory", "Source", "Experiment",
)  # fmt: skip
"""Types of arguments by which a function or class takes a mechanism."""

ELSEWHERE = {
    # What a run or a search returns, made by what is walked.
    "ContinuousTrajectory",
    "ClosedLoop",
    "StepDerivatives",
    "OptimizationResult",
    "Identification",
    "Followed",
    "Step",
    "Played",
    "ContinuousOptimizationResult",
    "ContinuousRollout",
    "ContinuousProjection",
    "LimitReport",
    # Made on the way, or of systems of any kind.
    "MidpointVI",
    "MidpointSystem",
    "optimize_continuous",
    "linearize_along_curve",
    "check_derivatives",
    "simulate",
    "mechanism_scene",
    "plot_descent",
    "plot_feedback",
    "CostOfConfigurations",
    "PulledSystem",
    "by_tensions",
    "play",  # with tests of their own: test_pulled.py, test_relaxation.py, test_rig.py
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("group", GROUPS)
def test_it_is_taken(case: str, group: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    wrong = []
    for name, call in GROUPS[group](CASES[case], tmp_path).items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = call()
        except ImportError:
            continue  # an optional program
        except Exception as error:
            wrong.append(f"{name}: {type(error).__name__}: {error}")
        else:
            if found is False:
                wrong.append(f"{name}: is not the same")
    assert not wrong, "\n".join(wrong)


def test_all_that_is_public_is_asked() -> None:
    asked = {name.rpartition(".")[2] for group in GROUPS.values() for name in group(CASES["floating"], Path())}
    missing = []
    for package in ("", ".control", ".identification", ".mechanics", ".optimal", ".systems", ".viz"):
        module = importlib.import_module(f"leastaction{package}")
        for name in module.__all__:
            it = getattr(module, name)
            if callable(it) and _takes_a_mechanism(it) and name not in asked | ELSEWHERE:
                missing.append(f"leastaction{package}.{name}")
    methods = {"Mechanism": Mechanism, "MidpointVI": MidpointVI, "Trajectory": Trajectory}
    for owner, kind in methods.items():
        for name, _ in inspect.getmembers(kind, inspect.isfunction):
            if not name.startswith("_") and name not in asked | INNER:
                missing.append(f"{owner}.{name}")
    called = {".".join(name.split(".")[-2:]) for group in GROUPS.values() for name in group(CASES["floating"], Path())}
    for module in (gymnasium, jax, python_control, torch):
        place = module.__name__.rpartition(".")[2]
        own = inspect.getmembers(module, lambda it, name=module.__name__: getattr(it, "__module__", "") == name)
        names = [f"{place}.{name}" for name, it in own if not name.startswith("_") and _takes_a_mechanism(it)]
        assert names
        missing += [name for name in names if name not in called]
    assert not missing


INNER = {
    # Of a mechanism: what else it is changed to, or asked; each with tests of its own.
    "at_time", "by_name", "configuration", "velocity", "copy", "fitted", "members_of", "parameter_places",
    "slots_of_elements", "with_bodies", "with_exchanged", "with_free_lengths", "with_joints", "constraint_jacobian",
    "constraint_rank", "constraint_residuals", "constraint_rates", "potential_energy", "moved_points",
    # Of an integrator and of a run.
    "like", "with_instants", "trajectory", "linearize_arrays", "start", "state", "energy", "tensions",
    "plot", "show", "load", "open", "signals", "to_dataset",
}  # fmt: skip


def _takes_a_mechanism(it: Any) -> bool:
    try:
        parameters = inspect.signature(it).parameters.values()
    except (TypeError, ValueError):
        return False
    words = [
        set(str(each.annotation).replace("|", " ").replace("[", " ").replace("]", " ").split()) for each in parameters
    ]
    return any(not each.isdisjoint(TAKEN_BY) for each in words)
