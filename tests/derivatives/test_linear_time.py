"""The O(n) solver of deep trees against the elimination of the Newton matrix itself."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives.random_tree import random_tree, step_problem
from leastaction import _core
from leastaction.mechanics import CoulombFriction, JointSpring, LinearSpring, MidpointVI
from leastaction.models.chain import pendulum_chain

SPLITS = ("symmetric", "left")


def run(
    mechanism: _core.Mechanism,
    solver: str,
    t: np.ndarray,
    x0: np.ndarray,
    u: np.ndarray,
    *,
    split: str = "symmetric",
) -> _core.RollOut:
    midpoint = _core.Midpoint(mechanism, split=_core.Split[split], solver=_core.Solver[solver])
    return midpoint.roll_out(t, x0, None, u, None)


def assert_same(ours: _core.RollOut, dense: _core.RollOut, tolerance: float) -> None:
    assert ours.steps == dense.steps == len(dense.u)
    assert ours.iterations == dense.iterations
    for name in ("x", "lam"):
        size = max(1.0, np.abs(getattr(dense, name)).max(initial=0.0))
        np.testing.assert_allclose(getattr(ours, name), getattr(dense, name), rtol=0, atol=tolerance * size)


# Random starts fling some trees about so fast that no step exists; these seeds have one.
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12])
def test_same_steps_on_random_trees(seed: int, split: str) -> None:
    """Branches, prescribed joints within the tree, damping and forces; with constraints and without."""
    tree = random_tree(seed)
    p = step_problem(tree.without_constraints() if seed % 3 == 2 else tree, seed)
    u = np.concatenate([p.inputs, p.rho_next])[None, :].repeat(3, axis=0)
    x0 = np.concatenate([p.q, p.p, p.v_rho])
    core, t = p.tree.core(), p.dt * np.arange(4.0)
    dense = run(core, "dense", t, x0, u, split=split)
    assert_same(run(core, "tree", t, x0, u, split=split), dense, 1e-10)


@pytest.mark.parametrize("joints", [12, 40, 90])
@pytest.mark.parametrize("seed", range(3))
def test_same_steps_on_larger_trees(seed: int, joints: int) -> None:
    """On either side of the crossover, with several constraints open or closed."""
    tree = random_tree(seed, joints=joints, kinematic=joints // 6, inputs=5)
    p = step_problem(tree.without_constraints() if seed == 2 else tree, seed, dt=1e-3)
    rng = np.random.default_rng(seed)
    q, nd = p.q, p.tree.n_dynamic
    u = np.concatenate([rng.uniform(-1.0, 1.0, 5), q[nd:]])[None, :].repeat(3, axis=0)
    x0 = np.concatenate([q, np.zeros(nd + p.tree.n_kinematic)])
    core, t = p.tree.core(), p.dt * np.arange(4.0)
    assert_same(run(core, "tree", t, x0, u), run(core, "dense", t, x0, u), 1e-10)


@pytest.mark.parametrize("links", [5, 20, 30, 60, 120])
def test_same_steps_of_a_chain(links: int) -> None:
    chain = pendulum_chain(links)
    x0 = np.zeros(chain.nx)
    x0[0] = 0.5
    x0[1:links] = 0.02 * np.sin(np.arange(1, links))
    t, u = 0.01 * np.arange(11), np.zeros((10, 0))
    dense = run(chain.core, "dense", t, x0, u)
    for solver in ("tree", "automatic"):
        assert_same(run(chain.core, solver, t, x0, u), dense, 1e-10)


def test_derivatives_are_those_of_the_dense_solver() -> None:
    links = 60
    chain = pendulum_chain(links)
    x0 = np.zeros(chain.nx)
    x0[:links] = 0.1
    t, u = 0.01 * np.arange(3), np.zeros((2, 0))
    x = run(chain.core, "automatic", t, x0, u).x
    auto, dense = (
        _core.Linearization(_core.Midpoint(chain.core, solver=_core.Solver[solver]), 2, False)
        for solver in ("automatic", "dense")
    )
    assert auto.along(t, x, u, 1) == dense.along(t, x, u, 1) == 2
    np.testing.assert_array_equal(auto.A, dense.A)


def test_energy_of_a_long_chain_stays_in_its_band() -> None:
    """And the band shrinks with the square of the step."""
    links = 100
    vi = MidpointVI(pendulum_chain(links))
    q = np.zeros(links)
    q[0] = 0.4
    bands = []
    for steps in (800, 1600):
        motion = vi.simulate(vi.start(q), np.linspace(0.0, 4.0, steps + 1))
        assert motion.steps == steps, motion.message
        energy = motion.energy()
        bands.append(np.ptp(energy.total) / np.ptp(energy.potential))
    assert bands[0] < 1e-6
    assert bands[0] / bands[1] == pytest.approx(4.0, rel=0.05)


def chain_at(origin: tuple[float, float, float], links: int, *, last_spin: bool) -> _core.Mechanism:
    """Return a chain that hangs from `origin`; its last joint may turn a point mass about itself."""
    builder = _core.MechanismBuilder(links, 0, 0)
    for k in range(links):
        pose = np.eye(4)
        pose[:3, 3] = (0.0, 0.0, -1.0) if k else origin
        spins = last_spin and k == links - 1
        axis = [0.0, 0, 1] if spins else [1.0, 0, 0]
        joint = builder.add_joint(k - 1, pose, np.array([0.0, 0, 0, *axis]), k)
        inertia = np.zeros((3, 3)) if spins else 0.1 * np.eye(3)
        builder.add_body(joint, 1.0, np.array([0.0, 0, -1]), inertia)
    builder.set_gravity(np.array([0.0, 0, -9.8]))
    return builder.build()


def test_same_motion_far_from_the_origin() -> None:
    """All is in world coordinates: ten kilometres out, digits are lost, but no more than elsewhere."""
    links = 20
    core = chain_at((3e3, 8e3, 5e3), links, last_spin=False)
    x0 = np.zeros(2 * links)
    x0[0] = 0.5
    t, u = 0.01 * np.arange(11), np.zeros((10, 0))
    ours, dense = (run(core, solver, t, x0, u) for solver in ("tree", "dense"))
    assert ours.steps == dense.steps == 10
    size = np.abs(dense.x).max()
    np.testing.assert_allclose(ours.x, dense.x, rtol=0, atol=1e-10 * size)


def test_a_joint_that_moves_no_inertia_is_reported_alike() -> None:
    core = chain_at((0.0, 0.0, 0.0), 3, last_spin=True)
    x0, t, u = np.zeros(6), np.array([0.0, 0.01]), np.zeros((1, 0))
    x0[-1] = 0.1  # an angular momentum that nothing can carry
    ours, dense = (run(core, solver, t, x0, u) for solver in ("tree", "dense"))
    assert ours.steps == dense.steps == 0
    assert ours.status == dense.status == _core.StepStatus.singular


def test_a_very_long_chain_steps() -> None:
    """Neither memory nor time of a step may grow with the square of the number of links."""
    links = 1000
    vi = MidpointVI(pendulum_chain(links))
    q = np.zeros(links)
    q[0] = 0.2
    motion = vi.simulate(vi.start(q), 0.002 * np.arange(101))
    assert motion.steps == 100, motion.message


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(TypeError, match=r"leastaction\._core\.Solver"):
        _core.Midpoint(pendulum_chain(2).core, solver="sparse")


@pytest.mark.parametrize("split", SPLITS)
def test_springs_and_friction_at_joints_keep_the_solver(split: str) -> None:
    """They add to the diagonal alone; what reaches over two joints does not, and is left to the other solver."""
    n = 60
    chain = pendulum_chain(n)
    at_joints = [
        element
        for variable in chain.dynamic
        for element in (JointSpring(variable, 3.0, rest=0.1), CoulombFriction(variable, 0.2, 0.5))
    ]
    t, u = 2e-3 * np.arange(6.0), np.empty((5, 0))
    q = 0.05 * np.cos(np.arange(n))
    for elements in (at_joints, [*at_joints, LinearSpring("world", f"end{n // 2}", 5.0, 1.0)]):
        m = chain.with_elements(elements)
        x0 = MidpointVI(m).start(q).x
        dense = run(m.core, "dense", t, x0, u, split=split)
        ours = run(m.core, "tree", t, x0, u, split=split)
        assert ours.steps == dense.steps == 5
        # A rounding of 1e-16 in an angle is one of 4e-9 in the momentum of 60 links.
        np.testing.assert_allclose(ours.x, dense.x, rtol=0, atol=5e-9)
