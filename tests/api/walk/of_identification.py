"""Right calls of what finds parameters from measurements."""

from __future__ import annotations

import numpy as np

import leastaction as la
from api.walk.of_data import fields_of
from api.walk.values import Call
from leastaction import identification as idn
from leastaction.optimal import Parameter


def calls() -> dict[str, Call]:
    """Return a callable and right arguments by name."""
    vi = la.MidpointVI(slide(9.0), threads=1)
    t = 0.05 * np.arange(21)
    rng = np.random.default_rng(0)
    x = vi.simulate(vi.start([0.1]), t, inputs=[0.2])["x"] + 0.002 * rng.standard_normal(21)
    experiment = {
        "t": t, "measured": {"x": x}, "sigma": {"x": 0.002}, "inputs": {"push": 0.2}, "start": ([0.1], [0.0]),
        "free_start": True, "name": "first",
    }  # fmt: skip
    right = {
        "mechanism": slide(5.0), "data": [idn.Experiment(**experiment)], "parameters": [Parameter("spring.stiffness")],
        "horizons": [0.5, 1.0], "substeps": 1, "tolerance": 1e-10, "max_iterations": 50,
    }  # fmt: skip
    found = idn.identify(**right)

    def fitted(**given: object) -> idn.Identification:
        """Fit an experiment, much of which is looked at there alone."""
        return idn.identify(vi, idn.Experiment(**given), ["spring.stiffness"])

    return {
        "Experiment": (idn.Experiment, experiment),
        "Experiment in identify": (fitted, experiment),
        "identify": (idn.identify, right),
        "Identification": (idn.Identification, fields_of(found)),
        "Identification.__getitem__": (found.__getitem__, {"name": "spring.stiffness"}),
        "Identification.plot": (found.plot, {"title": "Identification"}),
    }


def slide(stiffness: float) -> la.Mechanism:
    """Return a mass on a spring that is pushed."""
    spring = la.JointSpring("x", stiffness, name="spring")
    return la.Mechanism([la.tx("x", mass=1.0)], [spring, la.JointForce("x", input="push")])
