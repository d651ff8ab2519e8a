"""Matrices with structure, and tests for the matrix classes of complementarity theory."""

from __future__ import annotations

from pricing_core.linalg.tridiagonal import Tridiagonal, solve_tridiagonal

__all__ = ["Tridiagonal", "solve_tridiagonal"]
