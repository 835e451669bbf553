"""Beginning again where a run is stuck or about to get lost: at first with dear inputs, then as it was asked for.

Far from any minimum, the steps of a search must be short, and lead into violent motions that the steps of time cannot
follow. Under inputs that cost `ease` times as much, and an end that costs less by its root, the minimum is close to the
motion that costs no effort; from there to the minimum of the cost that was asked for leads a path of minima. It is
followed by stages of ever less ease, none of which is solved further than the next one needs. Tried on the problems of
`benchmarks.robustness` that ended elsewhere: by the weight of the end alone 10 of 23 came to a minimum, by that of the
inputs alone 14, by both 15, and the motions that they came to cost less than those found otherwise.

Gaps between the steps are the other way to begin again, from the start that was given.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import changed
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.problem import DiscreteProblem
from leastaction.optimal.discrete.shooting import Gapped, ShootingProblem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.memory import Memory, Place, Start
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult

# Factor by which inputs are dearer in the first stage, and by which they are less so from one stage to the next.
_EASIEST, _STRIDE = 1e6, 10.0

# Part of the cost that is left to be gained where a stage but the last is over, and its most iterations.
_LOOSE, _LONGEST = 1e-2, 20

# Iterations after which a search over trajectories is a long one; and the most with gaps that take its place, where
# there are other ways.
_LONG, _BRIEF = 200, 40


class EasedProblem(ShootingProblem):
    """A discrete system and its cost, with ways to begin again: by an easier cost, where that offers one, or by gaps.

    ``asked``: the cost that is to be minimised; `cost` is that of the stage.
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Options,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
    ) -> None:
        super().__init__(system, cost, settings, free_start, gapped)
        self.asked = cost
        self.settings = settings
        self.ease = 1.0

    def start(self, initial: tuple[ArrayLike, ArrayLike]) -> None:
        super().start(initial)
        if not self.is_open:
            self.first = Start(self.x, self.u)

    def recall(self, memory: Memory) -> None:
        super().recall(memory)
        self._set_stage(memory.ease)

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended, in the stage that it had come to."""
        self._set_stage(1.0 if result.memory is None else result.memory.ease)
        super().resume(result)

    def memory(self) -> Memory:
        return changed(super().memory(), ease=self.ease)

    # ---- What the loop knows of a stage ---------------------------------------------------------

    @property
    def shown(self) -> float:
        """The cost that was asked for."""
        return super().shown if self.ease == 1.0 else self.asked.value(self.x, self.u)

    @property
    def longest_stage(self) -> int | None:
        """Iterations after which a stage that is not the last is over."""
        return super().longest_stage if self.ease == 1.0 else _LONGEST

    @property
    def unfinished(self) -> str:
        """What is to be said of a run that ends in a stage that is not the last."""
        if self.ease == 1.0:
            return super().unfinished
        return (
            f"It had begun again, and inputs are still {self.ease:.4g} times as dear as asked for: the iterations did "
            "not suffice for all stages."
        )

    def tolerated(self, goal: float) -> float:
        return super().tolerated(goal) if self.ease == 1.0 else max(goal, _LOOSE * abs(self.value))

    @property
    def long_run(self) -> int | None:
        if self.given is None or self.is_open or self.ease != 1.0:
            return None
        return super().long_run or _LONG

    @property
    def prefers_gaps(self) -> bool:
        """Whether gaps are more promising than an easier stage: where the start was lost when it was projected."""
        return self.given is not None and self.given.is_lost

    # ---- From stage to stage --------------------------------------------------------------------

    def begin_with_gaps(self, *, brief: bool) -> bool:
        """Begin again with gaps from the given start, once; return whether that can be done."""
        given = self.given
        if self.ease != 1.0 or given is None or not super().begin_with_gaps(brief=brief):
            return False
        if brief and not given.is_lost:
            self.longest = _BRIEF
        return True

    @property
    def remark(self) -> str:  # type: ignore[override]
        """What is to be said of a stage where it begins."""
        return "" if self.ease == 1.0 else f"inputs are {self.ease:.4g} times as dear as asked for"

    def begin_with_ease(self) -> bool:
        """Begin again with the motion that costs no effort, and with a cost whose minimum is close to it."""
        eased = None if self.is_open else self.asked.eased(_EASIEST)
        if eased is None:
            return False
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu

        def ease() -> bool:
            start = self._project(np.tile(self.x[0], (N + 1, 1)), eased[1], np.zeros((N, nu, ndx)))
            if np.array_equal(start.x, self.x):
                return False  # Where no step was possible, none is now.
            self._set_stage(_EASIEST)
            self.x, self.u = read_only(start.x), read_only(start.u)
            self.forget()
            self._project_curve(start)
            self.value = self.cost.value(self.x, self.u)
            return True

        return self._leave(ease)

    def next_stage(self, *, moved: bool = True) -> bool:
        """Go on with less ease, or over trajectories where there were gaps."""
        if self.ease == 1.0:
            return super().next_stage(moved=moved)
        self._set_stage(max(1.0, self.ease / _STRIDE))
        self.value = self.cost.value(self.x, self.u)
        self._forget_cost()
        return True

    def go_on_from(self, x: Array, u: Array, report: LimitReport | None) -> None:  # noqa: ARG002
        """Begin the last stage at a trajectory; ``report``: of the limits there, of a problem that has some."""
        self._set_stage(1.0)
        self.forget()
        DiscreteProblem.start(self, (x, u))

    def _leave(self, go: Callable[[], bool]) -> bool:
        """Go elsewhere; if that leads nowhere or is interrupted, it stands where it stood."""
        now, ease = self.place(), self.ease
        try:
            gone = go()
        except BaseException as error:
            self._set_stage(ease)
            self._go_to(now)
            if isinstance(error, LeastActionError):
                return False
            raise
        if not gone:
            self._set_stage(ease)
            self._go_to(now)
        return gone

    def _asked_at(self, place: Place) -> float:
        """Return the cost that was asked for, somewhere else."""
        return self.asked.value(place.x, place.u)

    def _set_stage(self, ease: float) -> None:
        eased = None if ease == 1.0 else self.asked.eased(ease)
        self.ease, self.cost = (1.0, self.asked) if eased is None else (ease, eased[0])
        # Only the last stage has to end at a minimum.
        self.tells_saddles = self.system.has_curvature and self.ease == 1.0
