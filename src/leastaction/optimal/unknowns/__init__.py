"""What is found beside the inputs: parameters of the system, its final time, a first state that returns."""

from __future__ import annotations
