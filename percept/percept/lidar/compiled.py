"""Numba's compiler with a type, so that kernels keep theirs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

__all__ = ["compiled"]

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function) -> _Function:
    """Compile a function at its first call and keep the machine code on disk.

    It runs without Python's lock, so that several threads may work on scans and images at once.

    Division by zero gives infinity, as in numpy: checking for it would keep loops from being
    vectorised.
    """
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))
