"""Words among which a user chooses, in Python as on the command line.

They stand outside of the marionette's folder, which takes as long to import as all else that ``--help`` needs.
"""

from __future__ import annotations

from typing import Literal

Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
"""An axis of a capture, and which way along it."""

Heading = Literal["facing", "travel", "axis", "straight"]
"""What of a capture is turned ahead: where the person faces, goes, the capture's own axis; or every slow turn."""

Follow = Literal["joints", "markers"]
"""What is followed: the angles of all joints, or the places of the markers."""

Axes = Literal["zyx", "quaternion"]
"""How pelvis, hips and shoulders turn: by three angles, or as ball joints."""

Strings = Literal[6, 7, 8, 9, 11, "cross", "cross+legs", "cross+hands", "cross+legs+hands"]
"""What the marionette hangs on: so many strings, each held by a hand, or seven of them tied to a control."""
