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
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.problem import DiscreteProblem
from leastaction.optimal.discrete.shooting import Gapped, ShootingProblem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.discrete.trial import COARSE
from leastaction.optimal.loop import Loop
from leastaction.optimal.memory import Memory, Place, Start
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.optimal.settings import Settings

# How much dearer inputs are in the first stage, and by which factor less from one stage to the next; how often its
# root is taken, to make a stage again that led nowhere.
_EASIEST, _STRIDE, _RETRIES = 1e6, 10.0, 2

# Into so many parts a step of time is divided that is too coarse.
_PARTS = 2

# A stage but the last is over where no more than this part of the cost is to be gained, or after so many iterations.
_LOOSE, _LONGEST = 1e-2, 20

# A search over trajectories is a long one after so many iterations; one with gaps that takes its place, where there are
# other ways, is over after so many.
_LONG, _BRIEF = 200, 40


class EasedProblem(ShootingProblem):
    """A discrete system and its cost, with ways to begin again: by an easier cost, where that offers one, or by gaps.

    ``asked``: the cost that is to be minimised; `cost` is that of the stage.
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Settings,
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
    ) -> None:
        super().__init__(system, cost, settings, free_start, gapped)
        self.asked = cost
        self.settings = settings
        self.stride, self.retries = _STRIDE, _RETRIES
        self.sound: Place | None = None
        self.first: Start | None = None
        self.plainly = False  # whether it goes from the first trajectory once more
        self.went_finer = False  # whether it was looked where half the steps of time lead: always to the same place

    def start(self, initial: tuple[ArrayLike, ArrayLike]) -> None:
        super().start(initial)
        if not self.is_open:
            self.first = Start(self.x, self.u)

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended, in the stage that it had come to."""
        self._set_stage(result.schedule.ease)
        super().resume(result)
        memory = result.memory
        if memory is not None:
            self.stride, self.retries = memory.stride, memory.retries
            self.sound, self.first = memory.sound, memory.first
            self.plainly = result.schedule.newton
            if memory.here is not None:
                self._go_to(memory.here)

    def memory(self) -> Memory:
        return replace(super().memory(), stride=self.stride, retries=self.retries, sound=self.sound, first=self.first)

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result at the current iterate, or where it stood before it set out again, if that is better."""
        result, ahead = super().result(summary), self._ahead
        if ahead is None or result.memory is None:
            return result
        return replace(self._of(ahead, result), memory=replace(result.memory, here=self._place()))

    @property
    def _ahead(self) -> Place | None:
        """Where it stood before it went from the first trajectory once more, while that is better."""
        if not self.plainly or self.earlier is None or self.is_open:
            return None
        return self.earlier if self._asked_at(self.earlier) < self.value else None

    def arrive(self) -> None:
        self.plainly = False

    def fall_back(self) -> bool:
        self.plainly = False
        return super().fall_back()

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
        if self._ahead is not None:
            return (
                "It had set out again from where it had begun, and has not come as far yet: what is returned is the "
                "trajectory that it had come to before."
            )
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

    def begin_again(self) -> bool:
        """Begin again with the motion that costs no effort, and with a cost whose minimum is close to it."""
        eased = None if self.is_open else self.asked.eased(_EASIEST)
        if eased is None:
            return False
        N, nx, nu = self.system.N, self.system.nx, self.system.nu

        def ease() -> bool:
            start = self._project(np.tile(self.x[0], (N + 1, 1)), eased[1], np.zeros((N, nu, nx)))
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
        if self.worst_step is None or self.worst_step.s <= COARSE:
            self.sound = self._place()
        self._set_stage(max(1.0, self.ease / self.stride))
        self.value = self.cost.value(self.x, self.u)
        self._forget_cost()
        return True

    def retry_stage(self) -> bool:
        """Go back to the last stage that ended well, and on from there by a shorter stride."""
        if self.sound is None or self.retries == 0:
            return False
        now = self._place()
        self._remember(now)
        self.retries -= 1
        self.stride = float(np.sqrt(self.stride))
        self._go_to(replace(self.sound, ease=max(1.0, self.sound.ease / self.stride)))
        return True

    def begin_plainly(self) -> bool:
        """Begin again with the first trajectory, once; return whether that can be done."""
        first, self.first = self.first, None
        if first is None or self.is_open:
            return False

        def again() -> bool:
            # What a system of a user's own says now need not be what it said then.
            return self._stand_at(first.x, first.u) and np.allclose(self.x, first.x, rtol=1e-6, atol=1e-6)

        self.plainly = self._leave(again)
        return self.plainly

    def begin_finer(self) -> bool:
        """Begin again from what half the steps of time lead to, where those that were given are too coarse."""
        if self.went_finer or self.free_start is not False:
            return False
        system, cost = self.system.refined(_PARTS), self.asked.refined(_PARTS)
        eased = None if cost is None else cost.eased(1.0)
        if system is None or cost is None or eased is None:
            return False

        def refine() -> bool:
            finer = EasedProblem(system, cost, self.settings)
            finer.start((self.x[0], eased[1]))
            finer.first = None  # one way there is enough
            found = Loop(finer, self.settings, schedule=NewtonSchedule(finer=True)).run()
            self.rollouts += found.rollouts
            if found.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            self.went_finer = True
            if found.worst_step is None or found.worst_step.is_coarse:
                return False
            return self._stand_at(found.x[::_PARTS], self.system.merged_inputs(found.u, _PARTS))

        return self._leave(refine)

    def _leave(self, go: Callable[[], bool]) -> bool:
        """Go elsewhere and remember where it stood; if that leads nowhere or is interrupted, it stands there again."""
        now = self._place()
        try:
            gone = go()
        except BaseException as error:
            self._go_to(now)
            if isinstance(error, LeastActionError):
                return False
            raise
        if gone:
            self._remember(now)
        else:
            self._go_to(now)
        return gone

    def _stand_at(self, x: Array, u: Array) -> bool:
        """Begin the last stage at the projection of a curve."""
        self.plainly = False
        self._set_stage(1.0)
        self.forget()
        DiscreteProblem.start(self, (x, u))
        return True

    def _asked_at(self, place: Place) -> float:
        """Return the cost that was asked for, somewhere else."""
        return self.asked.value(place.x, place.u)

    def _place(self) -> Place:
        return replace(super()._place(), ease=self.ease)

    def _go_to(self, place: Place) -> None:
        self._set_stage(place.ease)
        super()._go_to(place)

    def _set_stage(self, ease: float) -> None:
        eased = None if ease == 1.0 else self.asked.eased(ease)
        self.ease, self.cost = (1.0, self.asked) if eased is None else (ease, eased[0])
        # Only the last stage has to end at a minimum.
        self.tells_saddles = self.system.has_curvature and self.ease == 1.0
