"""Whatever is given as an argument, what comes of it is an error of the package's own, or an answer, within seconds."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from api.wrong_arguments import WRONG, arm, calls

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.mechanics import check_consistent, equilibrium, project_configuration

CALLS = sorted(calls())
_SECONDS = 5.0  # of the processor, for all wrong values of one argument


@pytest.mark.parametrize("name", CALLS)
def test_every_wrong_value_of_every_argument_ends_in_a_named_error_or_an_answer(name: str) -> None:
    function, right = calls()[name]
    function(**right)
    untyped: list[str] = []
    for argument in right:
        began = time.process_time()
        for meaning, value in WRONG.items():
            said = untyped_answer(function, {**right, argument: value})
            if said:
                untyped.append(f"{argument} = {meaning}: {said}")
        if time.process_time() - began > _SECONDS:
            untyped.append(f"{argument}: took {time.process_time() - began:.1f} s")
    assert not untyped, "\n" + "\n".join(untyped)


def untyped_answer(function: Callable[..., object], arguments: dict[str, object]) -> str:
    """Return what is wrong with the answer to a call; empty where nothing is."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            function(**arguments)
        except LeastActionError as error:
            return "" if str(error) else "an error without words"
        except Exception as error:
            return f"{type(error).__name__}: {str(error)[:80]}"
    return ""


def test_silent_wrongs_are_refused() -> None:
    """What was taken in silence: tolerances that pass anything, iterations that end in an assertion."""
    off = [0.3, 0.8, 0.0]
    for tolerance in (np.inf, 1e300, True, [], 1 + 2j, np.nan, -1.0):
        with pytest.raises(ArgumentError, match="tolerance"):
            check_consistent(arm(), off, tolerance=tolerance)
        with pytest.raises(ArgumentError, match="tolerance"):
            project_configuration(arm(), off, tolerance=tolerance)
    for count in (-1, np.nan, 3.5, None):
        with pytest.raises(ArgumentError, match="max_iterations"):
            equilibrium(arm(), off, max_iterations=count)
        with pytest.raises(ArgumentError, match="max_iterations"):
            project_configuration(arm(), off, max_iterations=count)
    with pytest.raises(ArgumentError, match="move_kinematic"):
        project_configuration(arm(), off, move_kinematic="yes")
