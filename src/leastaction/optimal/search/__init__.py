"""Searches in steps of time, put together from an iterate, what is minimised, and where to begin."""
