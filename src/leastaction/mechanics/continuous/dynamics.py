"""Continuous time: accelerations, inverse dynamics, and exact derivatives of both orders.

With ``r = d/dt L_v - L_q - f`` the dynamic accelerations and the multipliers solve (dissertation chapter 3, A.1)::

    r(q, v, a, u) - Dh(q)^T lam = 0   (dynamic variables),   Dh a + v^T D2h v = 0

where the accelerations ``rho_a`` of the kinematic variables are given. The multipliers are those of ``M a + ... = f +
Dh^T lam``: per second the negative of the impulses of a `MidpointVI` step.
"""

from __future__ import annotations

from functools import partial
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, DynamicsError
from leastaction.mechanics.continuous.acceleration import AccelerationDerivatives, Accelerations, AccelerationTensors
from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, Row, as_array, as_count, as_number, require_instance, shape_of
from leastaction.numerics.memory import MAX_BYTES, check_memory
from leastaction.numerics.public import public


@public
class ContinuousDynamics:
    """Equations of motion of one mechanism in continuous time.

    It holds settings and no state, so any number of threads may share it.

    All methods take one point, or N of them: then every argument has a leading axis, or is the same for all. Every
    result has a leading axis if and only if q or v has.

    Where a rotation is a quaternion, its velocities and accelerations are the body's angular velocity and its
    derivative by time, in the axes of the body, and derivatives by q are by turns in these axes (nv of them).

    Parameters
    ----------
    mechanism : Mechanism
    constraint_damping, constraint_stiffness : float, optional
        Baumgarte's stabilisation: the constraints become ``h'' + damping h' + stiffness h = 0`` (1/s and 1/s^2), so
        that what a solver lets them drift comes back. Zero: ``h'' = 0``.
    threads : int, optional
        Threads for many points at once; 0: as many as there are cores.

    Raises
    ------
    ArgumentError
        For a damping, a stiffness or a count out of range.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        constraint_damping: float = 0.0,
        constraint_stiffness: float = 0.0,
        threads: int = 0,
    ) -> None:
        require_instance(mechanism, "mechanism", Mechanism)
        self.constraint_damping = as_number(constraint_damping, "constraint_damping", least=0.0)
        self.constraint_stiffness = as_number(constraint_stiffness, "constraint_stiffness", least=0.0)
        self.mechanism = mechanism
        self.threads = as_count(threads, "threads", 0)
        self.core = _core.Continuous(mechanism.core, self.constraint_damping, self.constraint_stiffness)

    def __reduce__(self) -> tuple[Any, ...]:
        # The core is made again from the settings, in a worker process too.
        settings = {name: getattr(self, name) for name in ("constraint_damping", "constraint_stiffness", "threads")}
        return partial(ContinuousDynamics, self.mechanism, **settings), ()

    def accelerations(
        self, q: Row, v: Row, u: ArrayLike | None = None, rho_a: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> Accelerations:
        """Return the accelerations and multipliers.

        Parameters
        ----------
        q, v : array_like, shape (nq,) and (nv,)
            Configuration (rad or m) and velocity. The constraints need not hold exactly: they may have drifted.
        u : array_like, shape (n_inputs,), optional
            Inputs; zero if not given.
        rho_a : array_like, shape (nrho,), optional
            Accelerations of the kinematic variables; zero if not given.
        t : float or array_like, shape (N,), optional
            Time (s), of which potentials and forces written as expressions may be functions.

        Raises
        ------
        ArgumentError
            For wrong shapes or values that are not finite.
        DynamicsError
            Where the equations have no solution: the inertia of a variable is lost to rounding, or the equations
            overflow.
        """
        points = self._points(q, v, u, rho_a, t)
        out = self._solved(self.core.accelerations(*points.arrays, self.threads, points.t), points)
        return Accelerations(points.shaped(out.a), points.shaped(out.lam), out.rank_deficient)

    def inverse_dynamics(
        self,
        q: Row,
        v: Row,
        a: ArrayLike,
        lam: ArrayLike | None = None,
        *,
        u: ArrayLike | None = None,
        t: ArrayLike = 0.0,
    ) -> Array:
        """Return the generalised force that a motion needs besides that of the elements.

        Parameters
        ----------
        q, v, a : array_like, shape (nq,), (nv,) and (nv,)
            Configuration, velocity and acceleration of all variables.
        lam : array_like, shape (nc,), optional
            Multipliers of constraints that carry their part; zero if not given.
        u : array_like, shape (n_inputs,), optional
            Inputs of the force elements; zero if not given, so that the result is what inputs have to do.
        t : float or array_like, shape (N,), optional
            Time (s).

        Returns
        -------
        ndarray, shape (nv,)
            ``d/dt L_v - L_q - f(q, v, u) - Dh^T lam`` (N or N m): of dynamic variables zero for a motion that
            `accelerations` gives for the same u, of kinematic ones what drives them.
        """
        m = self.mechanism
        points = self._points(q, v, u, None, t, a=a)
        multipliers = points.rows(lam, "lam", m.constraints)
        accelerations = points.rows(a, "a", m.variables)
        values, speeds, inputs, _ = points.arrays
        return points.shaped(
            self.core.inverse_dynamics(values, speeds, accelerations, inputs, multipliers, self.threads, points.t)
        )

    def linearize(
        self, q: Row, v: Row, u: ArrayLike | None = None, rho_a: ArrayLike | None = None, t: ArrayLike = 0.0
    ) -> AccelerationDerivatives:
        """Return the first derivatives; arguments and errors as of `accelerations`.

        Where constraints are redundant, the derivatives of the multipliers leave out how the choice among them turns.
        """
        m = self.mechanism
        points = self._points(q, v, u, rho_a, t)
        out = self._solved(self.core.linearize(*points.arrays, self.threads, t=points.t), points)
        return AccelerationDerivatives(
            points.shaped(out.a), points.shaped(out.lam), points.shaped(out.derivatives), (m.nd, m.nv, m.n_inputs)
        )

    def curvature(
        self,
        q: Row,
        v: Row,
        u: ArrayLike | None = None,
        rho_a: ArrayLike | None = None,
        t: ArrayLike = 0.0,
        *,
        z_a: ArrayLike | None = None,
        z_lam: ArrayLike | None = None,
    ) -> Array:
        """Return the second derivatives, contracted with weights.

        Parameters
        ----------
        q, v, u, rho_a, t
            As of `accelerations`, errors too.
        z_a : array_like, shape (nd,), optional
            Weights on the accelerations; zero if not given.
        z_lam : array_like, shape (nc,), optional
            Weights on the multipliers; zero if not given.

        Returns
        -------
        ndarray, shape (n, n), n = 2 nv + n_inputs + nrho
            Hessian of ``z_a . a + z_lam . lam`` by ``[q; v; u; rho_a]``, symmetric.

        Raises
        ------
        ArgumentError
            Also if a constraint is a `PythonConstraint`: of constraints the fourth order is needed, and a complex step
            gives the third.
        """
        m = self.mechanism
        self._check_orders()
        points = self._points(q, v, u, rho_a, t)
        weights = (points.rows(z_a, "z_a", m.dynamic), points.rows(z_lam, "z_lam", m.constraints))
        out = self.core.curvatures(*points.arrays, *weights, self.threads, t=points.t)
        return points.shaped(self._solved(out, points).derivatives)

    def tensors(
        self,
        q: Row,
        v: Row,
        u: ArrayLike | None = None,
        rho_a: ArrayLike | None = None,
        t: float = 0.0,
        *,
        max_bytes: float = MAX_BYTES,
    ) -> AccelerationTensors:
        """Return the full second derivatives at one point; arguments and errors as of `curvature`.

        They take ``8 (nd + nc) n^2`` bytes, ``n = 2 nv + n_inputs + nrho``: more than `max_bytes` is an `ArgumentError`
        before anything is made.
        """
        self._check_orders()
        m = self.mechanism
        n = 2 * m.nv + m.n_inputs + m.nrho
        check_memory((m.nd + m.nc, n, n), max_bytes, "tensors", "contract them by curvature(..., z_a=...)")
        points = self._points(q, v, u, rho_a, t)
        if not points.single:
            raise ArgumentError(f"tensors: got {len(points.arrays[0])} points, expected one: q of shape ({m.nq},)")
        out = self._solved(self.core.tensors(*points.arrays, points.t), points).derivatives
        return AccelerationTensors(out[: self.mechanism.nd], out[self.mechanism.nd :])

    def _points(
        self, q: Row, v: Row, u: ArrayLike | None, rho_a: ArrayLike | None, t: ArrayLike, *, a: ArrayLike | None = None
    ) -> _Points:
        m = self.mechanism
        given = (q, v) if a is None else (q, v, a)
        counts = [shape[0] for x in given if len(shape := shape_of(x) or ()) == 2]
        points = _Points(counts[0] if counts else 1, not counts)
        points.arrays = (
            configuration_on(m, points.rows(q, "q", m.coordinates), "q"),
            points.rows(v, "v", m.variables),
            points.rows(u, "u", m.inputs),
            points.rows(rho_a, "rho_a", m.kinematic),
        )
        many = len(shape_of(t) or ()) == 1
        points.t = as_array(t, "t", (points.count,)) if many else np.full(points.count, as_number(t, "t"))
        return points

    def _solved(self, out: _core.Accelerations, points: _Points) -> _core.Accelerations:
        """Return what the core returned, or raise the error that it tells of."""
        k = out.solved
        if k == points.count:
            return out
        m, at = self.mechanism, float(points.t[k])
        variable = None if out.variable is None else m.variables[out.variable]
        where = f"at t = {at:.6g} s" + ("" if points.single else f", point {k}")
        if out.status == _core.MotionStatus.not_finite:
            message = "a force, a constraint or the inertia is not finite; look for values that are too large"
        elif variable is not None:
            message = (
                f"the mass matrix is singular: {variable!r} has no inertia left that the other variables do not "
                "take up; give its frame a body, or keep a ball joint away from its singular angle"
            )
        else:
            message = "the equations of the constraints are singular"
        raise DynamicsError(f"no accelerations {where}: {message}", t=at, point=k, variable=variable)

    def _check_orders(self) -> None:
        for name, element in self.mechanism.elements.items():
            if element.equations and element.highest_order < 4:
                raise ArgumentError(
                    f"{name}: second derivatives in continuous time need the fourth order of every constraint, and a "
                    f"{type(element).__name__} gives the third; use an ExpressionConstraint, or first derivatives"
                )


class _Points:
    """Arguments of N points as arrays of N rows, and back to the shape in which they were given."""

    def __init__(self, count: int, single: bool) -> None:
        self.count = count
        self.single = single
        self.arrays: tuple[Array, Array, Array, Array]
        self.t: Array

    def rows(self, value: Row | None, what: str, names: tuple[str, ...]) -> Array:
        """Return one row for every point: zero if not given, the same for all if given once."""
        n = len(names)
        if value is None:
            return np.zeros((self.count, n))
        if _is_checked(value, (n,) if self.single else (self.count, n)):
            return value.reshape(self.count, n)
        if len(shape_of(value) or ()) == 2 and not self.single:
            return as_array(value, what, (self.count, n), names=names)
        row = as_array(value, what, (n,), names=names)
        return row[None, :] if self.single else np.tile(row, (self.count, 1))

    def shaped(self, result: Array) -> Array:
        return result[0] if self.single else result


def as_dynamics(dynamics: ContinuousDynamics | Mechanism) -> ContinuousDynamics:
    """Return the dynamics of a mechanism, without stabilisation; dynamics as they are."""
    if isinstance(dynamics, Mechanism):
        return ContinuousDynamics(dynamics)
    if not isinstance(dynamics, ContinuousDynamics):
        raise ArgumentError(f"dynamics: got {type(dynamics).__name__}, expected a Mechanism or its ContinuousDynamics")
    return dynamics


def _is_checked(value: object, shape: tuple[int, ...]) -> TypeGuard[Array]:
    """Whether a value is what `as_array` makes of it: in a solver's loop its questions take most of the time."""
    return (
        type(value) is np.ndarray
        and value.dtype == np.float64
        and value.shape == shape
        and value.flags.c_contiguous
        and bool(np.isfinite(value).all())
    )
