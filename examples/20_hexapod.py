"""A Stewart platform from its MJCF rolls and circles: six legs with a motor each, six loops closed, strokes in limits.

The wanted motion leans further than one leg reaches: that leg stops at its end, and the others do what is nearest.

    python examples/20_hexapod.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la

FILE = Path(__file__).parent / "models" / "stewart.xml"


def solve() -> tuple[la.starts.Followed, la.Trajectory]:
    """Return the motion that is nearest to what is wanted, and the same made anew from its forces alone."""
    model = la.load(FILE, axes="xyz")
    m, vi = model.mechanism, la.MidpointVI(model.mechanism)
    home = la.project_configuration(m, m.configuration(model.reference)).q
    t = np.linspace(0.0, 2.0, 201)
    w = np.pi * t
    grown = 0.5 - 0.5 * np.cos(w)  # from rest to rest
    wanted = {
        "platform.x": 0.08 * np.sin(w) * grown,
        "platform.y": 0.08 * (np.cos(w) - 1.0) * grown,
        "platform.z": m.named(home)["platform.z"] + 0.06 * grown,
        "platform.rx": 0.2 * np.sin(w) * grown,
        "platform.ry": 0.2 * np.sin(2.0 * w) * grown,
        "platform.rz": 0.3 * grown,
    }
    start = vi.start(home)
    found = la.follow(m, wanted, {"push *": 1e-9}, model.limits, t=t, start=start)
    return found, vi.simulate(start, t, inputs=found.trajectory.inputs)


def main(output: Path) -> tuple[la.starts.Followed, la.Trajectory]:
    """Solve, print and draw."""
    found, again = solve()
    m = again.mechanism
    off = max(np.degrees(found.errors[name]) for name in ("platform.rx", "platform.ry", "platform.rz"))
    print(f"off by {1e3 * found.errors['platform.z']:.1f} mm in height, {off:.2f} degrees (rms)")
    print(f"longest stroke {max(found.trajectory[f'leg {n}'].max() for n in range(1, 7)):.3f} m of 0.2")
    print(f"loops closed to {np.abs(m.constraint_values(again.q)).max():.1e} m")
    output.mkdir(parents=True, exist_ok=True)
    shown = la.show(found.result, shapes=la.load(FILE).shapes, traces=["platform"], title="Hexapod")
    shown.save(output / "20_hexapod.png", at=0.7)
    shown.save(output / "20_hexapod.html")
    return found, again


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
