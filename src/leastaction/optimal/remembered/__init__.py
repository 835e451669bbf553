"""Limits that look back: on what a system did in the step before, which becomes a part of its state."""
