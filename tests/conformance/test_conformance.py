"""Every conformance case: states, multipliers, first and second derivatives of an independent program.

The cases are in the folder that the environment variable CONFORMANCE_DIR names, by default
``../shared/conformance`` beside the checkout. Any case of the form that the folder's README states is taken.
"""

from __future__ import annotations

import json
import os
from functools import cache
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest

from conformance.loader import ELEMENTS, Case, load_case
from leastaction.mechanics import MidpointVI, State, Trajectory

FOLDER = Path(os.environ.get("CONFORMANCE_DIR") or Path(__file__).resolve().parents[3] / "shared" / "conformance")

# All element types that the form of the cases knows. A case is run as soon as the loader knows its types.
DOCUMENTED = {
    *("gravity", "linear_spring", "config_spring"),
    *("damping", "linear_damper", "config_force", "body_wrench", "spatial_wrench", "hybrid_wrench"),
    *("distance", "point_on_plane", "point_to_point_component"),
}

STATES, FIRST, SECOND, CONTRACTED = 1e-9, 1e-8, 1e-7, 1e-10


@cache
def case(path: Path) -> Case:
    return load_case(path)


def paths() -> list[Path]:
    return sorted(FOLDER.glob("*.json"))


def cases(needs: str | None = None) -> list:
    """Return the cases that can be run as parameters; of those with an array of the name `needs`."""
    out = []
    for path in paths():
        with np.load(path.with_suffix(".npz")) as stored:
            if not waiting_types(path) and (needs is None or needs in stored.files):
                out.append(pytest.param(path, id=path.stem))
    return out or [no_case()]


def all_cases() -> list:
    """Return every case; those that wait are listed in the summary of the run with what they wait for."""
    out = []
    for path in paths():
        types = sorted(waiting_types(path))
        reason = f"waiting for the elements {', '.join(types)}"
        marks = (pytest.mark.xfail(reason=reason, run=False),) if types else ()
        out.append(pytest.param(path, id=path.stem, marks=marks))
    return out or [no_case()]


def no_case() -> object:
    mark = pytest.mark.skip(reason=f"no conformance case that can be run in {FOLDER}")
    return pytest.param(None, id="none", marks=(mark,))


def waiting_types(path: Path) -> set[str]:
    data = json.loads(path.read_text())
    used = {entry["type"] for kind in ("potentials", "forces", "constraints") for entry in data[kind]}
    return used - set(ELEMENTS)


def assert_close(ours: np.ndarray, theirs: np.ndarray, tolerance: float, what: str) -> None:
    """Assert equality relative to the array's largest entry (to the tolerance itself where all vanish)."""
    assert ours.shape == theirs.shape, what
    if theirs.size:
        scale = np.abs(theirs).max() or 1.0
        error = np.abs(ours - theirs).max() / scale
        assert error <= tolerance, f"{what}: off by {error:.2g} of its largest entry {scale:.3g}"


def one_step(path: Path) -> tuple[MidpointVI, Trajectory, dict[str, np.ndarray]]:
    """Return the step at which the case states derivatives, as a trajectory."""
    mechanism, arrays, _ = case(path)
    vi = MidpointVI(mechanism, split="left", threads=1)
    k = int(arrays["deriv_step"])
    start = State(float(arrays["t"][k]), arrays["q"][k], arrays["p"][k], np.zeros(mechanism.nrho))
    t = arrays["t"][k : k + 2]
    return vi, vi.simulate(start, t, inputs=arrays["u"][k], rho=arrays["rho_next"][k]), arrays


def test_only_documented_elements_are_waited_for() -> None:
    for path in paths():
        unknown = waiting_types(path) - DOCUMENTED
        assert not unknown, f"{path.name}: nobody knows the element types {sorted(unknown)}"


@pytest.mark.parametrize("path", all_cases())
def test_case_is_read(path: Path) -> None:
    mechanism, arrays, waiting = case(path)
    assert waiting == []
    assert mechanism is not None
    assert arrays["q"].shape == (len(arrays["t"]), mechanism.nq)
    assert arrays["lam"].shape[1] == mechanism.nc


@pytest.mark.parametrize("path", cases())
def test_states(path: Path) -> None:
    mechanism, arrays, _ = case(path)
    vi = MidpointVI(mechanism, split="left")
    start = vi.start(arrays["q"][0], p=arrays["p"][0], t=float(arrays["t"][0]))
    run = vi.simulate(start, arrays["t"], inputs=arrays["u"], rho=arrays["rho_next"])
    assert run.steps == len(arrays["t"]) - 1, run.message
    for name, ours in {"q": run.q, "p": run.p}.items():
        assert_close(ours, arrays[name], STATES, name)
    # That program meets its equations to 1e-10, the constraints among them: to correct such an error of place
    # within a step takes an impulse of that times inertia / dt, which is in its multipliers. An impulse turns the
    # velocity before into the one after, so three places go into it, with the weights 1, -2, 1.
    inertia = np.abs(mechanism.mass_matrix(arrays["q"][0])).max()
    noise = 4e-10 * inertia / np.diff(arrays["t"]).min()
    largest = np.abs(arrays["lam"]).max(initial=1.0)
    assert_close(run.lam, arrays["lam"], max(STATES, noise / largest), "lam")
    assert np.ptp(arrays["q"][:, : mechanism.nd], axis=0).max() > 1e-3, "a case that does not move"


@pytest.mark.parametrize("path", cases("d_q2_dq1"))
def test_first_derivatives(path: Path) -> None:
    vi, run, arrays = one_step(path)
    m = vi.mechanism
    d = vi.linearize(run, multipliers=True)
    by_xu = np.concatenate([d.A, d.B], axis=2)[0]
    outputs = {
        "q2": by_xu[: m.nd],
        "p2": by_xu[m.nq : m.nq + m.nd],
        "lambda1": np.concatenate([d.lam_dx, d.lam_du], axis=2)[0],
    }
    for output, values in outputs.items():
        for argument, columns in arguments(vi).items():
            name = f"d_{output}_d{argument}"
            assert_close(values[:, columns], arrays[name], FIRST, name)


@pytest.mark.parametrize("path", cases("d_q2_dq1dq1"))
def test_second_derivatives(path: Path) -> None:
    vi, run, arrays = one_step(path)
    m = vi.mechanism
    full = vi.tensors(run, 0)
    outputs = {"q2": full.x[: m.nd], "p2": full.x[m.nq : m.nq + m.nd], "lambda1": full.lam}
    for output, tensor in outputs.items():
        for (name1, first), (name2, second) in combinations_with_replacement(arguments(vi).items(), 2):
            name = f"d_{output}_d{name1}d{name2}"
            ours = tensor[:, first, second]
            # Theirs: the two arguments first, the output last.
            assert_close(ours, np.moveaxis(arrays[name], -1, 0), SECOND, name)
            assert_close(tensor[:, second, first], ours.transpose(0, 2, 1), 1e-15, f"{name}, mirrored")


@pytest.mark.parametrize("path", cases())
def test_contracted_is_the_contraction_of_the_full_tensors(path: Path) -> None:
    vi, run, _ = one_step(path)
    m = vi.mechanism
    full = vi.tensors(run, 0)
    rng = np.random.default_rng(5)
    z, z_lam = rng.standard_normal(m.nx), rng.standard_normal(m.nc)
    ours = vi.curvature(run, vi.linearize(run), z[None], z_lam=z_lam[None])[0]
    assert_close(ours, np.tensordot(z, full.x, 1) + np.tensordot(z_lam, full.lam, 1), CONTRACTED, "H")
    without = vi.curvature(run, vi.linearize(run), z[None])[0]
    assert_close(without, np.tensordot(z, full.x, 1), CONTRACTED, "H without multipliers")


def arguments(vi: MidpointVI) -> dict[str, slice]:
    """Return where each argument of the cases' derivatives is in ``[x; u]``."""
    m = vi.mechanism
    return {
        "q1": slice(0, m.nq),
        "p1": slice(m.nq, m.nq + m.nd),
        "u1": slice(m.nx, m.nx + m.nu),
        "k2": slice(m.nx + m.nu, m.nx + m.nu + m.nrho),
    }
