"""Plans on rigs: machines that are not quite their models, with strings that go slack and sensors that are late."""

from __future__ import annotations
