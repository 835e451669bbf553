"""Iterates in steps of time: trajectories, and curves with gaps, with the models along them and what is minimised."""
