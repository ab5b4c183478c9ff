"""Ctrl-C between two scans instead of in the middle of one."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["deferred_interrupt", "prompt_interrupt"]


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], None]]:
    """Hold a Ctrl-C back until the block asks for it; a second one ends at once.

    Python raises `KeyboardInterrupt` wherever it happens to be. In a callback of compiled
    code it is lost, and in the middle of a write it would leave half a frame.

    Yields:
        A function that raises `KeyboardInterrupt` if Ctrl-C was pressed.
    """
    pressed = False

    def remember(_signal: int, _frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = True

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, remember)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def prompt_interrupt() -> Iterator[None]:
    """Let a Ctrl-C end the block at once, inside `deferred_interrupt` too.

    For long work that writes nothing and has no place to ask.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
