"""Memory of large results is kept for the next ones of the same size, and what was in it does not show."""

from __future__ import annotations

import resource
import sys

import numpy as np
import pytest

from leastaction import Gravity, Mechanism, MidpointSystem, MidpointVI, rx, tz

N, JOINTS = 2000, 12


def rods(kinematic: bool) -> MidpointSystem:
    """A chain of rods; the last of its joints are prescribed or not, as many states in both cases."""
    tree: list[object] = [tz(-0.1, mass=1.0)]
    for i in reversed(range(JOINTS)):
        tree = [
            rx(f"j{i}", kinematic=kinematic and i >= JOINTS - 3),
            tree if i == JOINTS - 1 else [tz(-0.1, mass=1.0), tree],
        ]
    mechanism = Mechanism(tree, [Gravity((0, 0, -9.81))])
    return MidpointSystem(MidpointVI(mechanism, threads=1), 1e-4 * np.arange(N + 1))


def at_rest(system: MidpointSystem) -> tuple[np.ndarray, np.ndarray]:
    m = system.integrator.mechanism
    q = m.configuration({f"j{i}": 0.1 for i in range(JOINTS)})
    u = np.tile(q[m.nd :], (N, 1))
    run = system.rollout(
        system.integrator.start(q).x, np.zeros((N + 1, system.nx)), u, np.zeros((N, system.nu, system.nx)), 0, N
    )
    assert run.complete
    return run.x, run.u


@pytest.mark.skipif(sys.platform != "linux", reason="counts pages as Linux does")
def test_what_is_made_again_needs_no_new_pages() -> None:
    system = rods(kinematic=False)
    x, u = at_rest(system)
    z = np.ones((N, system.nx))

    def pages() -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        linearization = system.linearize(x, u)
        size = linearization.A.nbytes + linearization.curvature(z).nbytes
        assert size > 2**24
        del linearization
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

    pages()
    assert min(pages() for _ in range(3)) < 200  # of 4500


def test_what_was_there_before_does_not_show() -> None:
    free, held = rods(kinematic=False), rods(kinematic=True)
    x, u = at_rest(free)
    linearization = free.linearize(x, u)
    linearization.curvature(np.ones((N, free.nx)))
    assert np.all(np.count_nonzero(linearization.A, axis=(1, 2)) == free.nx**2)
    del linearization
    m = held.integrator.mechanism
    found = held.linearize(*at_rest(held))
    rates = slice(m.nq + m.nd, held.nx)
    np.testing.assert_array_equal(found.A[:, m.nd : m.nq], 0.0)
    np.testing.assert_array_equal(found.A[:, :, rates], 0.0)
    np.testing.assert_array_equal(found.B[:, m.nd : m.nq], np.broadcast_to(np.eye(m.nrho), (N, m.nrho, m.nrho)))
    H = found.curvature(np.ones((N, held.nx)))
    np.testing.assert_array_equal(H[:, rates], 0.0)
    np.testing.assert_array_equal(H[:, :, rates], 0.0)
