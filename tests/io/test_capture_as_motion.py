"""Captures as motions of named variables, and as tables of text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from leastaction import read_motion
from leastaction.io import read_bvh

BVH = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT knee
  {
    OFFSET 0 -40 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.01
0 90 0 0 10 0 0 30 0
1 91 0 0 20 0 0 40 0
2 92 0 0 30 0 0 50 0
"""


def test_channels_have_names_and_units(tmp_path: Path) -> None:
    file = tmp_path / "squat.bvh"
    file.write_text(BVH)
    motion = read_bvh(file).motion(unit=0.01)
    assert motion.names[:4] == ("hips_tx", "hips_ty", "hips_tz", "hips_rz")
    np.testing.assert_allclose(motion["hips_ty"], [0.9, 0.91, 0.92])
    np.testing.assert_allclose(motion["knee_rx"], np.radians([30.0, 40.0, 50.0]))
    np.testing.assert_allclose(motion.t, [0.0, 0.01, 0.02])


def test_a_capture_goes_through_a_table_bit_by_bit(tmp_path: Path) -> None:
    file = tmp_path / "squat.bvh"
    file.write_text(BVH)
    motion = read_bvh(file).motion()
    again = read_motion(motion.save(tmp_path / "squat.csv"))
    assert again.names == motion.names
    np.testing.assert_array_equal(again.q, motion.q)
