"""An assembled configuration as its lengths change, against the projection onto the constraints of the changed one."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives.differences import extrapolated
from leastaction.errors import ArgumentError, InconsistentStartError
from leastaction.mechanics import (
    Distance,
    Mechanism,
    PointToPoint,
    configuration_by,
    project_configuration,
    rx,
    ty,
    tz,
)


def four_bar() -> Mechanism:
    """Return a crank, a coupler and a rocker, closed by a pin, with a rod from a slider to the coupler."""
    return Mechanism(
        [
            rx("a", mass=1.0, inertia=(0.1, 0.1, 0.1)),
            [tz(0.5, name="crank"), [rx("b", mass=1.0, inertia=(0.1, 0.1, 0.1)), [tz(0.9, name="coupler")]]],
            ty(0.7, name="ground"),
            [rx("c", mass=1.0, inertia=(0.1, 0.1, 0.1)), [tz(0.8, name="rocker")]],
            tz("reel", kinematic=True),
            [ty("s", mass=1.0, name="slider")],
        ],
        [PointToPoint("coupler", "rocker", "yz", name="pin"), Distance("slider", "coupler", 0.9, name="rod")],
    )


NAMES = ["crank.value", "rod.length", "ground.value", "slider.mass"]


@pytest.mark.parametrize("hold", [[], ["a"]])
def test_it_is_the_derivative_of_the_projection(hold: list[str]) -> None:
    m = four_bar()
    q = project_configuration(m, [0.9, -1.2, 0.3, -0.2, 0.1], hold=["reel"]).q
    by = configuration_by(m, q, NAMES, hold=hold)
    assert by.shape == (5, 4)
    assert np.abs(by[:, :3]).max(axis=0).min() > 0.1
    for column, name in enumerate(NAMES):

        def closed(by_value: float, name: str = name) -> np.ndarray:
            changed = m.with_parameters({name: m.parameters[name] + by_value})
            return project_configuration(changed, q, hold=[*hold, "reel"], tolerance=1e-14).q

        np.testing.assert_allclose(by[:, column], extrapolated(closed, 0.0, 1e-3), atol=1e-7)
    if hold:
        assert np.all(by[m.variables.index("a")] == 0.0)


def test_what_is_wrong_is_named() -> None:
    m = four_bar()
    q = project_configuration(m, [0.9, -1.2, 0.3, -0.2, 0.1], hold=["reel"]).q
    with pytest.raises(InconsistentStartError, match="rod"):
        configuration_by(m, q + 0.1, ["rod.length"])
    with pytest.raises(ArgumentError, match=r"rod\.lenght.*rod\.length"):
        configuration_by(m, q, ["rod.lenght"])
    with pytest.raises(ArgumentError, match="names: expected a list"):
        configuration_by(m, q, "rod.length")
    with pytest.raises(ArgumentError, match="nothing keeps the constraint"):
        configuration_by(m, q, ["rod.length"], hold=["a", "b", "c", "s"])
