"""Continuous time in every conformance case: accelerations, multipliers, and their first and second derivatives."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from conformance.test_conformance import (
    CONTRACTED,
    FIRST,
    SECOND,
    STATES,
    assert_close,
    case,
    cases,
)
from leastaction.mechanics import ContinuousDynamics

OUTPUTS = {"f": "a", "lambda": "lam"}


class At(NamedTuple):
    """A case's dynamics, its point as the arguments of every method, and its arrays."""

    dynamics: ContinuousDynamics
    point: tuple[np.ndarray, ...]
    arrays: dict[str, np.ndarray]


def at_point(path: Path) -> At:
    mechanism, arrays, _ = case(path)
    point = tuple(arrays[name] for name in ("c_q", "c_dq", "c_u", "c_ddk"))
    return At(ContinuousDynamics(mechanism, threads=1), point, arrays)


def arguments(dynamics: ContinuousDynamics) -> dict[str, slice]:
    """Return where each argument of the cases' derivatives is in ``[q; v; u; rho_a]``."""
    m = dynamics.mechanism
    ends = np.cumsum([0, m.nq, m.nq, m.nu, m.nrho])
    names = ("dq", "ddq", "du", "dddk")
    return {name: slice(*pair) for name, *pair in zip(names, ends[:-1], ends[1:], strict=True)}


@pytest.mark.parametrize("path", cases("c_ddq"))
def test_accelerations(path: Path) -> None:
    dynamics, point, arrays = at_point(path)
    out = dynamics.accelerations(*point)
    assert_close(out.a, arrays["c_ddq"], STATES, "a")
    assert_close(out.lam, arrays["c_lam"], STATES, "lam")


@pytest.mark.parametrize("path", cases("c_ddq"))
def test_inverse_dynamics_gives_back_what_drives_the_motion(path: Path) -> None:
    dynamics, point, arrays = at_point(path)
    m = dynamics.mechanism
    q, v, u, rho_a = point
    a = np.concatenate([arrays["c_ddq"], rho_a])
    needed = dynamics.inverse_dynamics(q, v, a, arrays["c_lam"], u=u)
    size = np.abs(m.mass_matrix(q)).max() * max(np.abs(a).max(), 1.0)
    assert np.abs(needed[: m.nd]).max() < STATES * size
    # The inputs' own part shows where they are left out.
    inputs = m.core.force(q, v, u) - m.core.force(q, v, 0.0 * u)
    without = dynamics.inverse_dynamics(q, v, a, arrays["c_lam"])
    assert np.abs(without - needed - inputs).max() < STATES * size


@pytest.mark.parametrize("path", cases("c_f_dq"))
def test_first_derivatives(path: Path) -> None:
    dynamics, point, arrays = at_point(path)
    d = dynamics.linearize(*point)
    ours = {
        "c_f_dq": d.a_dq,
        "c_f_ddq": d.a_dv,
        "c_f_du": d.a_du,
        "c_f_dddk": d.a_drho_a,
        "c_lambda_dq": d.lam_dq,
        "c_lambda_ddq": d.lam_dv,
        "c_lambda_du": d.lam_du,
        "c_lambda_dddk": d.lam_drho_a,
    }
    found = [name for name in ours if name in arrays]
    assert len(found) >= 4, "nothing is compared with nothing"
    for name in found:
        assert_close(ours[name], arrays[name], FIRST, name)


@pytest.mark.parametrize("path", cases("c_f_dqdq"))
def test_second_derivatives(path: Path) -> None:
    dynamics, point, arrays = at_point(path)
    full = dynamics.tensors(*point)
    compared = 0
    for output, attribute in OUTPUTS.items():
        tensor = getattr(full, attribute)
        for name1, first in arguments(dynamics).items():
            for name2, second in arguments(dynamics).items():
                name = f"c_{output}_{name1}{name2}"
                if name not in arrays:
                    continue
                ours = tensor[:, first, second]
                # Theirs: the two arguments first, the output last.
                assert_close(ours, np.moveaxis(arrays[name], -1, 0), SECOND, name)
                compared += arrays[name].size > 0
        assert_close(tensor, tensor.transpose(0, 2, 1), 1e-12, f"{output}, mirrored")
    assert compared >= 3


@pytest.mark.parametrize("path", cases("c_ddq"))
def test_contracted_is_the_contraction_of_the_full_tensors(path: Path) -> None:
    dynamics, point, _ = at_point(path)
    m = dynamics.mechanism
    full = dynamics.tensors(*point)
    rng = np.random.default_rng(5)
    z_a, z_lam = rng.standard_normal(m.nd), rng.standard_normal(m.nc)
    ours = dynamics.curvature(*point, z_a=z_a, z_lam=z_lam)
    expected = np.tensordot(z_a, full.a, 1) + np.tensordot(z_lam, full.lam, 1)
    assert_close(ours, expected, CONTRACTED, "H")
    without = dynamics.curvature(*point, z_a=z_a)
    assert_close(without, np.tensordot(z_a, full.a, 1), CONTRACTED, "H without multipliers")
