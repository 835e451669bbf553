"""The marionette on other sets of strings."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import check_consistent
from leastaction.errors import ArgumentError
from leastaction.models.marionette import (
    PLANE_HEIGHT,
    STRING_SETS,
    UNHELD,
    Count,
    marionette,
    rest_pose,
    set_of,
    strings_of,
)
from leastaction_marionette.tracking.problem import unheld


@pytest.mark.parametrize("count", STRING_SETS)
def test_every_set_hangs_straight_above_its_hooks(count: Count) -> None:
    m, by_tension = marionette(strings=count), marionette(strings=count, by="tension")
    assert len(m.constraints) == len(by_tension.inputs) == count
    assert strings_of(m) == strings_of(by_tension) == STRING_SETS[count]
    assert set_of(m) == set_of(by_tension) == count
    assert unheld(m) == (UNHELD if count < 8 else ())
    q = rest_pose(m)
    check_consistent(m, q)
    hooks, controls = (
        m.positions(q, names) for names in zip(*((s.hook, s.control) for s in strings_of(m)), strict=True)
    )
    np.testing.assert_allclose(hooks[:, :2], controls[:, :2], atol=1e-12)
    np.testing.assert_allclose(controls[:, 2], PLANE_HEIGHT)


def test_other_numbers_of_strings_are_none() -> None:
    with pytest.raises(ArgumentError, match="expected 6, 7, 8, 9, 11 strings"):
        marionette(strings=10)  # type: ignore[arg-type]
