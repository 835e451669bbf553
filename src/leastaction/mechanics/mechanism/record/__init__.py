"""A mechanism as plain data: what its file says, typed, and the way there and back, bit by bit."""

from __future__ import annotations

from leastaction.mechanics.mechanism.record.mechanism import mechanism_type, plan_data, plan_of, read_plan, write_plan

__all__ = ["mechanism_type", "plan_data", "plan_of", "read_plan", "write_plan"]
