"""Limits on motions: an interior point method inside of the optimiser's iteration."""
