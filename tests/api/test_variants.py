"""The compiled variants of the core compute the same thing, to rounding."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from leastaction import _core

PROGRAM = """
import json
import numpy as np
from leastaction import _core

rng = np.random.default_rng(7)
n = 9
builder = _core.MechanismBuilder(n, 0, 0)
joints = []
parents = [-1, 0, 1, 1, 0, 4, -1, 6, 6]  # in depth-first preorder
for i in range(n):
    pose = np.eye(4)
    pose[:3, 3] = rng.normal(size=3)
    twist = np.zeros(6)
    twist[3 + i % 3] = 1.0
    joints.append(builder.add_joint(parents[i], pose, twist, i))
    builder.add_body(joints[i], 1.0 + i, rng.normal(size=3), np.diag([1.0, 1.5, 2.0]))
builder.set_gravity(np.array([0.0, 0.0, -9.81]))
ends = [builder.add_point(joints[i], rng.normal(size=3)) for i in (7, 8)]
builder.add_distance(*ends, 1.0)
mechanism = builder.build()
q, v = rng.normal(size=n), rng.normal(size=n)
results = {
    "gradient": mechanism.gradient(q, v),
    "hessian": mechanism.hessian(q, v),
    "constraint_jacobian": [mechanism.constraint_jacobian(q)],
}
print(json.dumps({k: [np.ravel(a).tolist() for a in arrays] for k, arrays in results.items()}))
"""


def computed_by(variant: str) -> dict[str, list[list[float]]]:
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        env=os.environ | {"LEASTACTION_CORE": variant},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    values: dict[str, list[list[float]]] = json.loads(result.stdout)
    return values


@pytest.mark.parametrize("variant", _core.available_variants()[1:])
def test_variants_agree_to_rounding(variant: str) -> None:
    expected = computed_by(_core.available_variants()[0])
    got = computed_by(variant)
    for quantity, arrays in expected.items():
        for a, b in zip(arrays, got[quantity], strict=True):
            scale = np.max(np.abs(a))
            assert scale > 0
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-13 * scale, err_msg=quantity)
