"""The threads of the libraries for matrices."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which BLAS has one thread.

    More gain nothing on many matrices of a few hundred rows, and wait for each other on a busy machine: such a matrix
    was factored in 73 ms instead of 1.
    """
    context: AbstractContextManager[object] = _libraries().limit(limits=1, user_api="blas")
    return context


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries with threads of their own: to look for them takes as long as an iteration or two."""
    import scipy.linalg.lapack  # noqa: F401 - which has a BLAS of its own

    return ThreadpoolController()
