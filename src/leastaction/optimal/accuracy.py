"""How exactly differential equations are integrated."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.numerics.arrays import as_choice, as_count, as_number
from leastaction.numerics.ode import SOLVERS
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class Accuracy:
    """How differential equations are integrated.

    Attributes
    ----------
    solver : {"DOP853", "RK45", "RK23", "Radau", "BDF", "LSODA"}
        SciPy's integrator. The last three are for stiff equations.
    rtol, atol : float
        Error of one step that is allowed, ``atol + rtol * |y|``.
    max_steps : int
        Steps of one integration after which it is given up.
    """

    solver: str = "DOP853"
    rtol: float = 1e-9
    atol: float = 1e-11
    max_steps: int = 20_000

    def __post_init__(self) -> None:
        as_choice(self.solver, "solver", SOLVERS)
        # SciPy does not go below 100 times the rounding unit.
        as_number(self.rtol, "rtol", above=3e-14, below=0.1)
        as_number(self.atol, "atol", above=0.0)
        as_count(self.max_steps, "max_steps", 1)

    @property
    def sampling(self) -> float:
        """Relative tolerance to which functions of time are sampled.

        It is above the error of the integrators' interpolants, whose kinks cannot be resolved.
        """
        return max(10.0 * self.rtol, 1e-12)
