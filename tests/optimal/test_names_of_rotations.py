"""A quaternion is meant by the name of its joint: in states, free starts, motions that return, and limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from leastaction import Bound, Mechanism, MechanismSystem, MidpointSystem, MidpointVI, Periodic, ball, tx
from leastaction.errors import ArgumentError

HULL = Mechanism([tx("rail", mass=0.3), [ball("hull", mass=1.0, com=(0.0, 0.0, 0.1), inertia=(0.03, 0.04, 0.05))]])


def discrete() -> MidpointSystem:
    return MidpointSystem(MidpointVI(HULL), np.linspace(0.0, 1.0, 5))


@pytest.mark.parametrize("names", [["hull"], ["hull", "p_hull"], ["p_hull", "rail"]])
def test_a_joint_is_meant_by_its_name(names: list[str]) -> None:
    """What is free at the start, and what returns: its quaternion, and the momenta of its turns."""
    system = discrete()
    each = {"hull": [f"hull.q{x}" for x in "wxyz"], "p_hull": [f"p_hull.w{x}" for x in "xyz"], "rail": ["rail"]}
    spelt = [one for name in names for one in each[name]]
    assert system.free_entries(names) == system.free_entries(spelt)
    assert Periodic(names).entries(system) == Periodic(spelt).entries(system)
    x = MidpointVI(HULL).start([0.0, 1.0, 0.0, 0.0, 0.0]).x
    directions = 3 * ("hull" in names) + 3 * ("p_hull" in names) + ("rail" in names)
    assert system.start_directions(x, names).shape == (system.ndx, directions)
    with pytest.raises(ArgumentError, match="unknown name 'hul'; did you mean"):
        system.free_entries(["hul"])


@pytest.mark.parametrize("make", [discrete, lambda: MechanismSystem(HULL)], ids=["discrete", "continuous"])
def test_a_state_is_given_by_joints(make: Callable[[], MidpointSystem | MechanismSystem]) -> None:
    system = make()
    turns = "p_hull" if isinstance(system, MidpointSystem) else "v_hull"
    one_by_one = {"rail": 0.1, "hull.qw": 0.6, "hull.qy": 0.8, "hull.qz": 0.0, "hull.qx": 0.0, f"{turns}.wx": 0.3}
    together = {"rail": 0.1, "hull": [0.6, 0.0, 0.8, 0.0], turns: [0.3, 0.0, 0.0]}
    np.testing.assert_array_equal(system.state_given(together), system.state_given(one_by_one))
    with pytest.raises(ArgumentError, match=r"the value of 'hull': got shape \(3,\), expected \(4,\)"):
        system.state_given({"hull": [0.0, 0.0, 1.0]})


def test_limits_are_on_all_turns_of_a_joint() -> None:
    system = discrete()
    for of in ("rate", "momentum", "acceleration"):
        by_joint, spelt = (Bound(name, -1.0, 1.0, of=of).rows(system, 1) for name in ("hull", "hull.w*"))
        assert [row.quantity.names for row in by_joint] == [row.quantity.names for row in spelt]
        assert len(by_joint[0].quantity.names) == 3
    with pytest.raises(ArgumentError, match="unknown name 'hull'"):
        Bound("hull", -1.0, 1.0).rows(system, 1)
