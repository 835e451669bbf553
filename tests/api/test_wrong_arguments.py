"""Whatever is given as an argument, what comes of it is an error of the package's own, or an answer, within seconds."""

from __future__ import annotations

import enum
import importlib
import inspect
import time
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from api.walk import of_control, of_data, of_files, of_identification, of_mechanics, of_optimal
from api.walk.scenes import arm
from api.walk.values import WRONG, Call
from leastaction.errors import ArgumentError, KeywordError, LackingArgumentError, LeastActionError
from leastaction.mechanics import CoulombFriction, check_consistent, equilibrium, project_configuration
from leastaction.numerics.public import called_publicly
from leastaction.optimal import optimize

GROUPS = {
    "mechanics": of_mechanics, "optimal": of_optimal, "files": of_files, "data": of_data, "control": of_control,
    "identification": of_identification,
}  # fmt: skip
PACKAGES = (
    "leastaction", "leastaction.control", "leastaction.costs", "leastaction.elements", "leastaction.expressions",
    "leastaction.identification", "leastaction.io", "leastaction.limits", "leastaction.mechanics",
    "leastaction.models", "leastaction.optimal", "leastaction.starts", "leastaction.systems", "leastaction.viz",
)  # fmt: skip
_SECONDS = 5.0  # of the processor, for all wrong values of one argument
_SAMPLE = {"files": 17}  # of so many wrong values one is tried of every argument where not all are, else of 7

# What functions return and nobody makes; and bases, whose arguments are those of what is derived from them.
RETURNED = {
    "AccelerationDerivatives", "AccelerationTensors", "Accelerations", "Affine", "Branch", "Composition",
    "ConfigurationProjection", "ContinuousLinearQuadraticSolution", "ContinuousOptimizationResult",
    "ContinuousRollout", "ContinuousState", "Contradiction", "Controllability", "ControllabilityWindow", "CostAlong",
    "CostGradient", "CostHessian", "CostOfAccelerations", "DenseTrajectory", "DerivativeReport", "DiscreteBalance",
    "Drift", "Energy", "Equilibrium", "EventRecord", "Frame", "FunctionDerivatives", "FunctionReport", "HessianPart",
    "IterationRecord", "LimitReport", "LimitState", "LinearQuadraticSolution", "Linearization", "LoopBands",
    "ModelHessian", "MovedPoints", "OptimizationHistory", "PricedLimits", "RateGradient", "RateHessian", "Rollout",
    "Rotations", "Sensitivity", "Stability", "SteadyGain", "Step", "StepDerivatives", "StepSensitivity",
    "StepTensors", "TrackingErrors", "Unknown", "VelocityProjection", "Wrench",
}  # fmt: skip
# What the applications use that are built on the package.
OF_APPLICATIONS = {
    "PricedLimit", "Provenance", "axis_rotation", "check_result", "count_steps", "linearize_along_curve", "new_figure",
    "panel_grid", "styled", "tension_panel",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def public_names() -> dict[str, Any]:
    """Return everything that a public package offers and that can be called, by name."""
    found: dict[str, Any] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            it = getattr(module, name)
            if inspect.isfunction(it) or (
                inspect.isclass(it) and not issubclass(it, (BaseException, enum.Enum)) and not inspect.isabstract(it)
            ):
                found[name] = it
    return found


@pytest.mark.parametrize("group", GROUPS)
def test_wrong_values_of_every_argument_end_in_a_named_error_or_an_answer(group: str) -> None:
    """A sample: of every argument some wrong values."""
    assert not walked(GROUPS[group].calls(), _SAMPLE.get(group, 7))


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_every_wrong_value_of_every_argument_ends_in_a_named_error_or_an_answer(group: str) -> None:
    assert not walked(GROUPS[group].calls(), 1)


def walked(calls: dict[str, Call], sample: int) -> list[str]:
    """Return what is wrong with calls, each argument of which has one wrong value in turn."""
    found = []
    for name, (function, right) in calls.items():
        function(**right)
        flags = called_publicly(function).flags
        for argument in right:
            began = time.process_time()
            first = zlib.crc32(f"{name} {argument}".encode()) % sample
            for meaning, value in list(WRONG.items())[first::sample]:
                if said := untyped_answer(function, {**right, argument: value}, argument in flags):
                    found.append(f"{name}({argument} = {meaning}): {said}")
            if time.process_time() - began > _SECONDS * len(WRONG):
                found.append(f"{name}({argument}): took {time.process_time() - began:.1f} s")
    return found


def untyped_answer(function: Callable[..., object], arguments: dict[str, object], flag: bool = False) -> str:
    """Return what is wrong with the answer to a call; empty where nothing is."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            function(**arguments)
        except LeastActionError as error:
            return "" if str(error) else "an error without words"
        except Exception as error:
            return f"{type(error).__name__}: {str(error)[:80]}"
    return "taken for True or False" if flag and not any(each is True for each in arguments.values()) else ""


def test_everything_public_is_walked() -> None:
    """A new function or class has a right call in `api/walk`, or is returned by one."""
    walked_names = {name.partition(" in ")[0].removeprefix("element ") for it in GROUPS.values() for name in it.calls()}
    missing = sorted(set(public_names()) - walked_names - RETURNED - OF_APPLICATIONS)
    assert not missing


def test_everything_public_is_called_through_checks() -> None:
    unchecked = []
    for name, it in public_names().items():
        called = it if inspect.isfunction(it) else vars(it).get("__init__")
        if inspect.isfunction(called) and not issubclass(it if inspect.isclass(it) else object, tuple):
            unchecked += [] if hasattr(called, "__is_public__") else [name]
    assert not unchecked


@pytest.mark.parametrize("group", GROUPS)
def test_wrong_keywords_name_what_was_called_and_the_nearest(group: str) -> None:
    for name, (function, right) in GROUPS[group].calls().items():
        if (
            not right
            or not (hasattr(function, "__is_public__") or inspect.isclass(function))
            or issubclass(function if inspect.isclass(function) else object, tuple)
        ):
            continue
        longest = max(right, key=len)
        told = f"has no argument '{longest}_'; did you mean .*'{longest}'"
        with pytest.raises(KeywordError, match=told) as caught:
            function(**{**right, f"{longest}_": None})
        assert str(caught.value).partition(":")[0].endswith(name.partition(" in ")[0].rpartition(".")[2])


def test_silent_wrongs_are_refused() -> None:
    """What was taken in silence: tolerances that pass anything, iterations that end in an assertion."""
    off = [0.3, 0.8, 0.0]
    for tolerance in (np.inf, 1e300, True, [], 1 + 2j, np.nan, -1.0):
        with pytest.raises(ArgumentError, match="check_consistent: tolerance"):
            check_consistent(arm(), off, tolerance=tolerance)
        with pytest.raises(ArgumentError, match="project_configuration: tolerance"):
            project_configuration(arm(), off, tolerance=tolerance)
    for count in (-1, np.nan, 3.5, None):
        with pytest.raises(ArgumentError, match="equilibrium: max_iterations"):
            equilibrium(arm(), off, max_iterations=count)
        with pytest.raises(ArgumentError, match="project_configuration: max_iterations"):
            project_configuration(arm(), off, max_iterations=count)
    with pytest.raises(ArgumentError, match="move_kinematic"):
        project_configuration(arm(), off, move_kinematic="yes")


def test_arguments_that_are_lacking_are_named() -> None:
    for call, told in (
        (lambda: CoulombFriction("a", 2.0), "CoulombFriction: lacks speed"),  # type: ignore[call-arg]
        (lambda: optimize(), "optimize: lacks system, cost"),  # type: ignore[call-overload]
        (lambda: arm().frame_pose([0.3, 0.8, 0.0]), r"Mechanism\.frame_pose: lacks name"),  # type: ignore[call-arg]
    ):
        with pytest.raises(LackingArgumentError, match=told):
            call()
        with pytest.raises(TypeError, match=told):
            call()
    with pytest.raises(KeywordError) as caught:
        arm().frame_pose([0.3, 0.8, 0.0], "world", axes_of_it=1.0)  # type: ignore[call-arg]
    assert "self" not in str(caught.value)


def test_too_many_arguments_by_place_name_what_goes_by_name() -> None:
    with pytest.raises(ArgumentError, match=r"optimize: got 3 arguments by their place, .*\(system, cost\).*initial="):
        optimize(None, None, None)  # type: ignore[misc,arg-type]
    with pytest.raises(ArgumentError, match=r"Mechanism.frame_pose: got 3 arguments .* at most 2 \(q, name\)"):
        arm().frame_pose([0.3, 0.8, 0.0], "world", 1.0)  # type: ignore[call-arg]
