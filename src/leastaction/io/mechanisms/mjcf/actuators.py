"""The actuators of an MJCF as forces with an input each."""

from __future__ import annotations

from typing import Any

from leastaction.io.mechanisms.mjcf.found import Found
from leastaction.io.mechanisms.mjcf.spec import is_limited, mujoco_module
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.mechanics import JointForce
from leastaction.mechanics.elements import Element
from leastaction.optimal import Bound


def elements_of_actuators(spec: Any, names: Names) -> Found:
    """Return the actuators of a specification: motors on joints that have a variable of their own."""
    mujoco = mujoco_module()
    elements: list[Element] = []
    limits: list[Bound] = []
    left_out: list[LeftOut] = []
    inputs: list[str | None] = []
    for number, actuator in enumerate(spec.actuators):
        name = actuator.name or f"{actuator.target}.motor{number}"
        plain = (
            actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
            and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
            and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
            and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
            and actuator.target in names.values
            and names.is_own(actuator.target)
        )
        gain = float(actuator.gear[0] * actuator.gainprm[0]) if plain else 0.0
        if gain == 0.0:
            left_out.append(LeftOut(f"actuator {name!r}", "only motors on joints are taken over yet"))
            inputs.append(None)
            continue
        u = names.input(name)
        inputs.append(u)
        elements.append(JointForce({actuator.target: gain}, u, name=f"motor.{name}"))
        if is_limited(actuator.ctrllimited, actuator.ctrlrange, actuator.compiler):
            limits.append(Bound(u, float(actuator.ctrlrange[0]), float(actuator.ctrlrange[1]), of="input"))
    return Found(tuple(elements), tuple(limits), tuple(left_out), tuple(inputs))
