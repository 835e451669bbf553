"""The elastic barrier of a limit ``c >= 0``, in closed form.

Written with a slack s and an excess t, ``c = s - t``, a limit costs ::

    psi(c) = min over s, t > 0 with s - t = c of  rho t - mu log(t) - mu log(s)

which is smooth and finite for every c. As mu goes to 0 it becomes ``rho max(0, -c)``, the exact penalty: a limit that
can be met is met, to within mu, once the price rho is larger than its dual. So any trajectory is a start, a line
search needs nothing but this value, and where limits contradict each other, what remains of t says which and where.

At the minimum ``mu/s + mu/t = rho``. The dual is ``y = mu/s = -psi'(c)``, between 0 and rho. A primal-dual method
carries duals of its own: eliminating s, t and their changes from Newton's equations of ``s y = mu``,
``t (rho - y) = mu`` and ``c = s - t`` leaves ``dy = (mu/s - y) - sigma dc`` with the stiffness
``sigma = 1 / (s/y + t/(rho - y))``. The linear part of the model is thus the gradient of psi itself, whatever the
duals: its minimum is a direction of descent.
"""

from __future__ import annotations

from leastaction import _core
from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty


def first_duals(barrier: Array, rho: Array) -> Array:
    """Return duals to begin with, given those of the barrier.

    Of a limit that is not met the barrier is all but linear. With a small dual its model has its minimum where the
    limit is just met.
    """
    out: Array = empty(barrier.shape)
    _core.barrier_first_duals(barrier, rho, out)
    return out
