"""Limits and free initial states in continuous time: the horizon in pieces, each a step of a collocation method.

A piece of the horizon is a step of the Radau IIA method: the state is a polynomial that obeys the dynamics at the
piece's points, the input one through its values there. So a continuous system on a mesh is a discrete one, and all that
is built on those holds for it: limits at all points, exact second derivatives, the certified minimum.
"""
