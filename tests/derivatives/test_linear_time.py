"""The O(n) solvers of deep trees and of loops against the elimination of the Newton matrix itself."""

from __future__ import annotations

import time

import numpy as np
import pytest

from derivatives.random_tree import random_tree, step_problem
from leastaction import _core
from leastaction.mechanics import (
    CoulombFriction,
    Damping,
    Distance,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    project_velocity,
    world,
)
from leastaction.models.chain import pendulum_chain
from leastaction.models.scissor_lift import at_angle, scissor_lift

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


def assert_same(ours: _core.RollOut, dense: _core.RollOut, tolerance: float, more: int = 0) -> None:
    """Compare runs; ``more`` iterations may differ where rounding decides whether a step is done."""
    assert ours.steps == dense.steps == len(dense.u)
    assert abs(ours.iterations - dense.iterations) <= more
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


def ball_tree(*elements: Element) -> Mechanism:
    """A free base with two arms that hold balls, hinges and a prescribed ball, and a ball with a ball behind it."""
    solid = {"com": (0.03, 0.1, -0.2), "inertia": (0.02, 0.03, 0.025, 0.001, -0.002, 0.003)}
    base = world().free("base", mass=3.0, **solid)
    left = base.tx(0.2).ball("shoulder", mass=1.0, **solid).tz(-0.4).ry("elbow", mass=0.5, **solid)
    left.tz(-0.4).ball("wrist", mass=0.3, **solid).tz(-0.1, name="fingers")
    right = base.tx(-0.2).ball("held", kinematic=True, mass=0.4, **solid).tz(-0.3)
    for name in ("a", "b", "c"):
        right = right.ball(name, mass=0.4, **solid).tz(-0.3)
    return Mechanism(base, [Gravity(), *elements])


AT_BALLS = (
    Damping({"shoulder.wx": 0.2, "base.wz": 0.3, "elbow": 0.1}),
    JointForce("wrist.wy", "twist"),
    JointSpring("a.wx", 2.0, 0.1),
)


@pytest.mark.parametrize(
    "elements",
    [(), AT_BALLS, (Distance("fingers", "world", float(np.hypot(0.2, 0.9))),)],
    ids=["free", "joints", "rod"],
)
def test_same_steps_where_balls_turn(elements: tuple[Element, ...]) -> None:
    """By far, with and without what acts on their joints; as many iterations as with the matrix itself."""
    m = ball_tree(*elements)
    rng = np.random.default_rng(4)
    q, v = m.configuration(), 4.0 * rng.standard_normal(m.nv)
    start = MidpointVI(m).start(q, project_velocity(m, q, v).v if m.nc else v)
    u = np.r_[0.3 * np.ones(m.n_inputs), 0.1, -0.2, 0.05][None].repeat(6, axis=0)
    t = 0.02 * np.arange(7.0)
    dense = run(m.core, "dense", t, start.x, u)
    assert dense.steps == 6
    assert_same(run(m.core, "tree", t, start.x, u), dense, 1e-11)


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


def lift_start(mechanism: Mechanism, angle: float) -> np.ndarray:
    return MidpointVI(mechanism).start(*at_angle(mechanism, angle)).x


def string_of_particles(count: int) -> tuple[Mechanism, np.ndarray]:
    """Particles that rods join to each other, the first one to the world; and where they curl."""
    tree, angle = world(), 0.3 * np.sin(0.1 * np.arange(count)).cumsum()
    places = 0.1 * np.stack([np.cos(angle), 0.1 * np.sin(3.0 * angle), np.sin(angle)], axis=1).cumsum(axis=0)
    for k in range(count):
        tree.tx(f"x{k}").ty(f"y{k}").tz(f"z{k}", name=f"p{k}", mass=0.1)
    ends = ["world", *(f"p{k}" for k in range(count))]
    lengths = np.linalg.norm(np.diff(places, axis=0, prepend=0.0), axis=1)
    rods = [Distance(a, b, length) for a, b, length in zip(ends, ends[1:], lengths, strict=False)]
    m = Mechanism(tree, [Gravity((0.0, 0.0, -9.81)), *rods])
    q = np.array([places[int(name[1:]), "xyz".index(name[0])] for name in m.variables])
    return m, np.concatenate([q, np.zeros(m.nq)])


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("segments", [1, 2, 5, 12, 30])
def test_same_steps_of_a_lift(segments: int, split: str) -> None:
    """Loops that follow one another are eliminated with what moves them; where no digits are lost to the motion."""
    lift = scissor_lift(segments, damping=0.1)
    t, u = 0.01 * np.arange(9), np.full((8, 1), 0.3)
    x0 = lift_start(lift, 1.0)
    ours, dense = (run(lift.core, solver, t, x0, u, split=split) for solver in ("loops", "dense"))
    assert_same(ours, dense, 1e-6 if segments == 30 else 1e-8, more=8)  # rounding of the start moves it as much


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_same_steps_of_a_string_of_particles(count: int) -> None:
    """Distances between bodies of three joints each, of which the first that goes may not move its end at all."""
    m, x0 = string_of_particles(count)
    t, u = 0.01 * np.arange(9), np.empty((8, 0))
    assert_same(run(m.core, "loops", t, x0, u), run(m.core, "dense", t, x0, u), 1e-9, more=8)


@pytest.mark.parametrize("seed", range(4))
def test_same_steps_with_loops_across_a_tree(seed: int) -> None:
    """Joints in space, branches, loops within a branch and between several, one end in the world."""
    rng = np.random.default_rng(seed)
    tree = world()
    for branch in range(3):
        place = tree.tx(0.5 * branch)
        for k in range(5):
            turn = {0: place.rx, 1: place.ry, 2: place.rz}[int(rng.integers(3))]
            place = turn(f"a{branch}{k}").tz(-0.4, name=f"p{branch}{k}", mass=1.0, inertia=(0.02, 0.03, 0.04))
    m = Mechanism(tree, [Gravity((0.0, 0.0, -9.81))])
    q = rng.uniform(-0.4, 0.4, m.nq)
    names = [("p02", "p13"), ("p04", "p24"), ("p12", "p14"), ("world", "p23")]
    ends = m.positions(q, ["p02", "p13", "p04", "p24", "p12", "p14", "p23"])
    at = dict(zip(["p02", "p13", "p04", "p24", "p12", "p14", "p23"], ends, strict=True)) | {"world": np.zeros(3)}
    m = m.with_elements([Distance(a, b, float(np.linalg.norm(at[a] - at[b]))) for a, b in names])
    x0 = MidpointVI(m).start(q).x
    t, u = 0.004 * np.arange(9), np.empty((8, 0))
    assert_same(run(m.core, "loops", t, x0, u), run(m.core, "dense", t, x0, u), 1e-9, more=8)


def test_redundant_loops_are_left_to_the_pivots_of_all() -> None:
    """A pin twice: the multiplier of least norm, and the run says so."""
    lift = scissor_lift(12)
    lift = lift.with_elements([PointToPoint("middle_L3", "middle_R3", "xz", name="again")])
    t, u = 0.01 * np.arange(5), np.zeros((4, 1))
    x0 = lift_start(lift, 1.0)
    ours, dense = (run(lift.core, solver, t, x0, u) for solver in ("automatic", "dense"))
    assert ours.rank_deficient
    assert dense.rank_deficient
    assert_same(ours, dense, 1e-8, more=4)


def test_time_of_a_lift_grows_with_its_length() -> None:
    """Not with its square or cube, as that of a Schur complement of all pins does."""
    times = []
    for segments in (16, 64):
        lift = scissor_lift(segments)
        vi, t, u, x0 = MidpointVI(lift, threads=1), 0.01 * np.arange(11), np.zeros((10, 1)), lift_start(lift, 1.0)
        best = np.inf
        for _ in range(15):
            begin = time.thread_time()
            assert vi.core.roll_out(t, x0, None, u, None).steps == 10
            best = min(best, time.thread_time() - begin)
        times.append(best)
    assert times[1] < 4.0**1.4 * times[0]


def test_a_thousand_distances_step() -> None:
    m, x0 = string_of_particles(1000)
    run_of_all = MidpointVI(m).core.roll_out(0.01 * np.arange(4), x0, None, np.empty((3, 0)), None)
    assert run_of_all.steps == 3
