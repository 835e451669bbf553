"""Limits on the motions of discrete systems: an interior point method inside of the optimiser's iteration."""
