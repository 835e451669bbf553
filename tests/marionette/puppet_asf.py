"""Writes ASF and AMC files of a person with the puppet's proportions, every bone with axes of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from leastaction_marionette import VARIABLES, Proportions
from marionette.puppet_bvh import Y_UP, FloatArray

NAMES = {"leg": ("hipjoint", "femur", "tibia", "foot"), "arm": ("clavicle", "humerus", "radius", "wrist")}


def write_puppet(
    path: Path,
    q: FloatArray,
    *,
    order: str = "XYZ",
    radians: bool = False,
    unit: float = 0.0254,
    rate: float | None = None,
) -> Path:
    """Write the puppet in the poses `q` (F, 22) as ``path`` (AMC) and an ASF file beside it; return the first.

    ``order``: of the axes. ``unit``: of the files (m). ``rate``: frames a second that the file says.
    """
    sizes, rng = Proportions(), np.random.default_rng(1)
    value = {name: q[:, column] for column, name in enumerate(VARIABLES)}
    bones: list[str] = []
    tree: dict[str, list[str]] = {"root": []}
    moves: dict[str, FloatArray] = {}
    unit_of_angle = np.pi / 180.0 if radians else 1.0

    def turned(*names: str) -> FloatArray:
        axes = "".join(name[-1].upper() for name in names)
        angles = np.stack([value[name] for name in names], axis=1)
        return np.asarray(Y_UP @ Rotation.from_euler(axes, angles).as_matrix() @ Y_UP.T)

    def bone(name: str, parent: str, end: FloatArray, turn: FloatArray | None = None, *, hinge: bool = False) -> None:
        # The hinge's axis stays one axis of the bone; else the bone may have any.
        tilt = np.array([40.0, 0.0, 0.0]) if hinge else rng.uniform(-90.0, 90.0, 3)
        C = Rotation.from_euler(order.lower(), tilt[["XYZ".index(each) for each in order]], degrees=True)
        place = Y_UP @ end / unit
        length = float(np.linalg.norm(place))
        direction = place / length if length else np.array([0.0, 1.0, 0.0])
        axis = " ".join(repr(float(each)) for each in tilt * unit_of_angle)
        bones.extend(["  begin", f"     id {len(bones)}", f"     name {name}"])
        bones.append("     direction " + " ".join(map(repr, direction.tolist())))
        bones.extend([f"     length {length!r}", f"     axis {axis}  {order}"])
        if turn is not None:
            M = C.inv() * Rotation.from_matrix(turn) * C
            angles = M.as_euler(order.lower(), degrees=not radians)
            by_axis = np.stack([angles[:, order.index(each)] for each in "XYZ"], axis=1)
            if hinge:
                assert np.abs(by_axis[:, 1:]).max() < 1e-9
            moves[name] = by_axis[:, :1] if hinge else by_axis
            bones.extend(["    dof rx", "    limits (-10.0 170.0)"])
            if not hinge:
                bones[-2:] = ["    dof rx ry rz", "    limits (-160.0 20.0)", "           (-70.0 70.0)", "  (-60 70)"]
        bones.append("  end")
        tree.setdefault(parent, []).append(name)

    root = Rotation.from_matrix(turned("torso_rz", "torso_ry", "torso_rx")).as_euler(order.lower(), degrees=not radians)
    turns = np.stack([root[:, order.index(each)] for each in "XYZ"], axis=1)
    moves["root"] = np.hstack([q[:, :3] @ Y_UP.T / unit, turns])
    for side in ("left", "right"):
        for limb, hinges in (("leg", ("hip", "knee")), ("arm", ("shoulder", "elbow"))):
            first, second = sizes.bones(limb)  # type: ignore[arg-type]
            letter = side[0]
            base, upper, lower, end = (letter + name for name in NAMES[limb])
            bone(base, "root", np.array(sizes.attachment(side, limb)))  # type: ignore[arg-type]
            bone(upper, base, np.array([0, 0, -first]), turned(*(f"{letter}{hinges[0]}_r{axis}" for axis in "zyx")))
            bone(lower, upper, np.array([0, 0, -second]), turned(f"{letter}{hinges[1]}_rx"), hinge=True)
            bone(end, lower, np.array([0, 0.1, 0]))
    skeleton = [
        "# a comment", ":version 1.10", ":name puppet", ":units", "  mass 1.0", "  length 1.0",
        f"  angle {'rad' if radians else 'deg'}", ":documentation", "   any words begin here", ":root",
        "   order TX TY TZ RX RY RZ", f"   axis {order}", "   position 0 0 0", "   orientation 0 0 0",
        ":bonedata", *bones, ":hierarchy", "  begin",
        *(f"    {' '.join([parent, *children])}" for parent, children in tree.items()), "  end",
    ]  # fmt: skip
    motion = ["# another", ":FULLY-SPECIFIED", ":RADIANS" if radians else ":DEGREES"]
    motion += [] if rate is None else [f":SAMPLES-PER-SECOND {rate}"]
    for k in range(len(q)):
        motion.append(str(k + 1))
        motion += [f"{name} " + " ".join(map(repr, rows[k].tolist())) for name, rows in moves.items()]
    path.with_suffix(".asf").write_text("\n".join(skeleton) + "\n", encoding="utf-8")
    path.write_text("\n".join(motion) + "\n", encoding="utf-8")
    return path
