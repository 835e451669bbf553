"""A puppet from a URDF without masses: it is given bodies, hung on strings below a trolley, and walks."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import leastaction as la

MODELS = Path(os.environ.get("LEASTACTION_MODELS") or Path(__file__).resolve().parents[4] / "shared/data/models")
FILE = MODELS / "manual_puppet.urdf"
pytestmark = pytest.mark.skipif(not FILE.is_file(), reason="the puppet's URDF is not here")
CEILING = 1.5
HOOKS = [f"{side}_{part}_hook" for part in ("shoulder", "hand", "knee") for side in ("left", "right")]
BENT = {"elbow_phi": -1.2, "hip_phi": -0.4, "knee_phi": 0.4}


def rod(mass: float, length: float) -> la.Body:
    across = mass * length**2 / 12.0
    return la.Body(mass, com=(0.0, 0.0, -length / 2.0), inertia=(across, across, 0.5 * mass * 0.025**2))


def on_strings() -> tuple[la.Mechanism, np.ndarray]:
    """Return the puppet below a trolley, six strings to be drawn in, and where it hangs in equilibrium."""
    bodies = {
        "torso": la.Body(1.0, com=(0.0, 0.0, -0.1), inertia=(0.02, 0.015, 0.01)),
        "head": la.Body(0.3, inertia=[6e-4] * 3),
    }
    for side in ("left", "right"):
        bodies |= {f"{side}_humerus": rod(0.15, 0.2), f"{side}_radius": rod(0.12, 0.2)}
        bodies |= {f"{side}_femur": rod(0.3, 0.35), f"{side}_tibia": rod(0.25, 0.3)}
    m = la.load(FILE, floating=True, bodies=bodies, axes="xyz").mechanism
    bent = {f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in BENT.items()}
    places = dict(zip(HOOKS, m.positions(m.configuration(bent), HOOKS), strict=True))
    ends = [[la.tx(x), [la.ty(y, name=f"above {hook}")]] for hook, (x, y, _) in places.items()]
    hung = m.with_frames(
        "world", [la.tz(CEILING), [la.ty("trolley", kinematic=True), [f for end in ends for f in end]]]
    )
    strings = [la.Distance(hook, f"above {hook}", f"length of {hook}", name=hook) for hook in HOOKS]
    puppet = hung.with_elements([*strings, la.Damping(0.02)])
    lengths = {f"length of {hook}": CEILING - z for hook, (_, _, z) in places.items()}
    return puppet, la.equilibrium(puppet, puppet.configuration(bent | lengths)).q


def walk(m: la.Mechanism, rest: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    """Return two strides forward, arms against legs, the shins as they hang."""
    at = dict(zip(m.variables, rest, strict=True))
    free = ("knee_phi", "_psi", "_theta")
    wanted = {name: np.full(len(t), at[name]) for name in m.dynamic if not name.endswith(free)}
    gently = np.sin(np.minimum(t / 0.8, 1.0) * np.pi / 2.0) ** 2
    swing = gently * np.sin(2.0 * np.pi * t / 1.2)
    wanted["torso.y"] = wanted["torso.y"] - 0.3 * gently * t
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint, size in (("hip_phi", -0.3), ("shoulder_phi", 0.2), ("elbow_phi", 0.2)):
            wanted[f"{side}_{joint}"] = wanted[f"{side}_{joint}"] + sign * size * swing
    return wanted


def test_the_puppet_walks_on_strings_that_only_pull() -> None:
    m, rest = on_strings()
    assert m.kinematic == ("trolley", *(f"length of {hook}" for hook in HOOKS))
    assert m.mass == pytest.approx(2.94)
    t = np.linspace(0.0, 2.4, 241)
    vi = la.MidpointVI(m)
    start = vi.start(rest)
    wanted = walk(m, rest, t)
    pull = la.Bound("*", min=0.1, of="tension")
    found = la.follow(m, wanted, {"acceleration of *": 1e-4}, [pull], t=t, start=start)
    assert found.result.status.name == "CONVERGED"
    assert max(found.errors.values()) < 0.06, found.errors  # rad and m; hips swing by 0.3, the torso goes 0.72
    run = found.trajectory
    between = m.positions(run.q, HOOKS) - m.positions(run.q, [f"above {hook}" for hook in HOOKS])
    lengths = run.q[:, m.nq - len(HOOKS) :]
    np.testing.assert_allclose(np.linalg.norm(between, axis=2), lengths, rtol=0.0, atol=1e-10)
    assert min(tension.min() for tension in run.tensions().values()) > 0.1 - 1e-4
    again = vi.simulate(start, t, rho=run.q[:, m.nd :])
    np.testing.assert_allclose(again.q, run.q, rtol=0.0, atol=1e-8)
