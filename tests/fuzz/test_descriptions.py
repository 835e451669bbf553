"""Random descriptions, sound and broken: none crashes, none gives NaN, what is broken is a typed error.

A crash of the core would end the process, and pytest with it.
"""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass, field

import hypothesis
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from fuzz.damage import UsersMistake
from fuzz.describe import Description, build, descriptions
from fuzz.pieces import ELEMENTS
from fuzz.questions import Answers, ask_all, changes
from leastaction import mechanics as la
from leastaction.errors import LeastActionError

# Angles of many turns are asked for on purpose here.
pytestmark = pytest.mark.filterwarnings("ignore::leastaction.errors.UnitWarning")

# Numbers so large or small that results overflow, and functions of the user's own that have no value: what is
# asked of such a mechanism may be infinite or NaN. What it has moved through is finite all the same.
EXTREME = {"huge", "tiny", "not finite"}
DAMAGES = [
    "wrong type", "wrong shape", "not finite", "huge", "tiny", "zero", "negative", "empty", "unknown name",
    "duplicate", "misfit", "massless", "cyclic", "contradiction",
]  # fmt: skip


@dataclass
class Tally:
    """How many descriptions came to what."""

    outcomes: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    damages: Counter[str] = field(default_factory=Counter)

    def share(self, outcome: str) -> float:
        return self.outcomes[outcome] / self.outcomes["all"]


def run(examples: int) -> Tally:
    """Try descriptions about every element type in turn."""
    tally = Tally()
    for number, kind in enumerate(ELEMENTS):
        # Seeded: the same examples everywhere, and other ones for every type.
        @hypothesis.seed(number)
        @settings(
            max_examples=examples,
            database=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate, Phase.shrink],
        )
        @given(it=descriptions(kind))
        def one(it: Description) -> None:
            hypothesis.event(describe_and_ask(it, tally))

        one()
    return tally


def describe_and_ask(it: Description, tally: Tally) -> str:
    """Build one mechanism and ask it everything; return what it came to."""
    damage = it.damage
    tally.outcomes["all"] += 1
    if damage is not None:
        tally.damages[damage.kind] += 1
    refusal, mechanism = None, None
    try:
        mechanism = build(it)
        if it.changes is not None:
            mechanism = mechanism.with_parameters(changes(mechanism, it.seed, it.changes))
    except LeastActionError as error:
        refusal = error
    except UsersMistake:
        return "the user's own error"
    if refusal is not None:
        assert damage is not None, f"refused: {refusal}"
        assert str(refusal)
        tally.outcomes["refused"] += 1
        tally.refused[damage.where] += 1
        return f"refused: {damage.kind}"
    assert mechanism is not None
    assert damage is None or not damage.certain, f"taken: {damage}"
    tally.outcomes["accepted"] += 1
    tally.accepted.update(it.types)
    try:
        answers = ask_all(mechanism, it.seed)
    except UsersMistake:
        return "the user's own error"
    judge(it, answers)
    tally.outcomes[answers.stepped] += 1
    return answers.stepped


def judge(it: Description, answers: Answers) -> None:
    """Check the answers: without damage all are numbers, and only the start may be an error."""
    kind = it.damage.kind if it.damage is not None else "sound"
    assert not answers.undefined or kind in EXTREME, answers.undefined
    if kind == "contradiction" and it.damage is not None and it.damage.where == "Distance":
        assert answers.stepped == "no start"
    for question, error in answers.errors:
        assert str(error)
        if kind != "sound" or question == "start":
            continue
        # Gravity on some frames has masses of its own, which other parameters stand for as well.
        assert question == "by parameters", f"{question}: {error}"
        assert "also sets the weight" in str(error)


def test_every_element_type_is_drawn():
    families = {la.Element, la.Potential, la.Force, la.Constraint, la.Wrench}
    types = {
        name
        for name in la.__all__
        if isinstance(kind := getattr(la, name), type) and issubclass(kind, la.Element) and kind not in families
    }
    assert types == set(ELEMENTS)


def test_some_descriptions():
    tally = run(10)
    assert tally.outcomes["all"] >= 300
    assert tally.share("accepted") >= 0.3
    # Ten of a type: which they are, and so how many are broken, depends on the version of hypothesis.
    assert tally.share("refused") >= 0.1
    assert tally.share("completed") >= 0.2
    assert set(tally.accepted) == set(ELEMENTS)


@pytest.mark.slow
def test_ten_thousand_descriptions():
    tally = run(-(-10_000 // len(ELEMENTS)))
    assert tally.outcomes["all"] >= 10_000
    assert tally.share("accepted") >= 0.3
    assert tally.share("refused") >= 0.3
    assert tally.share("completed") >= 0.3
    assert tally.outcomes["step failed"] >= 10
    assert all(tally.accepted[kind] >= 20 for kind in ELEMENTS), tally.accepted
    assert all(tally.refused[kind] >= 20 for kind in ELEMENTS), tally.refused
    assert all(tally.damages[kind] >= 20 for kind in DAMAGES), tally.damages


def test_warnings_are_errors_here():
    with pytest.raises(RuntimeWarning):
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
