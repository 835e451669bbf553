"""Motions that have a closed form, each with its source."""

from __future__ import annotations

import numpy as np
from scipy.special import ellipj, ellipk


def pendulum_period(amplitude: float, length: float = 1.0, gravity: float = 9.81) -> float:
    """Return the period (s) of a point mass on a rod that swings to +-amplitude (rad).

    ``T = 4 sqrt(l/g) K(k)`` with the modulus ``k = sin(amplitude / 2)``.
    """
    return 4.0 * np.sqrt(length / gravity) * float(ellipk(np.sin(amplitude / 2.0) ** 2))


def pendulum_angle(t: np.ndarray, amplitude: float, length: float = 1.0, gravity: float = 9.81) -> np.ndarray:
    """Return the angle (rad) of that pendulum at times t (s) after its release at rest.

    ``sin(theta / 2) = k cd(omega t) = k cn / dn``, by Jacobi's functions of the modulus k.
    """
    k = np.sin(amplitude / 2.0)
    _, cn, dn, _ = ellipj(np.sqrt(gravity / length) * np.asarray(t), k**2)
    return 2.0 * np.arcsin(k * cn / dn)


def damped_velocity(t: np.ndarray, v0: float, mass: float, damping: float, force: float) -> np.ndarray:
    """Return the velocity (m/s) of a mass under a constant force and linear damping."""
    final = force / damping
    return final + (v0 - final) * np.exp(-damping / mass * np.asarray(t))


def steady_precession(tilt: float, spin: float, about_axis: float, across: float, weight: float) -> float:
    """Return the slow rate (rad/s) of steady precession of a heavy symmetric top.

    ``across' cos(tilt) W^2 - about_axis spin W + weight = 0`` with ``spin`` the whole angular velocity about
    the top's axis, ``about_axis`` and ``across`` the moments of inertia about the pivot, and ``weight`` its
    mass times g times the distance of the centre of mass from the pivot.
    """
    a, b = across * np.cos(tilt), -about_axis * spin
    return float((-b - np.sqrt(b**2 - 4.0 * a * weight)) / (2.0 * a))
