"""Systems and costs held to their definitions: every derivative to differences of the order below."""

from __future__ import annotations

from leastaction.optimal.checks.check import DerivativeReport, check_derivatives

__all__ = ["DerivativeReport", "check_derivatives"]
