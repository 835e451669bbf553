"""What is computed outlives the terminal: output that cannot be printed, and signals that end the program."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, TextIO

_ENDING = (signal.SIGTERM, signal.SIGHUP)


class Output:
    """A text stream that falls silent when it cannot be written, in place of ending the program.

    ``error``: why it is silent.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.error: OSError | None = None
        if hasattr(stream, "reconfigure"):
            # A terminal that knows no degree sign gets a question mark, not an error.
            stream.reconfigure(errors="replace")

    def write(self, text: str) -> int:
        """Write, where that is still possible."""
        if self.error is None:
            try:
                self._stream.write(text)
            except OSError as error:
                self.error = error
        return len(text)

    def flush(self) -> None:
        """Flush, where that is still possible."""
        if self.error is None:
            try:
                self._stream.flush()
            except OSError as error:
                self.error = error

    def close_if_silent(self) -> None:
        """Throw away what could not be written, which Python would try again when it exits."""
        self.flush()
        if self.error is not None:
            with contextlib.suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def shielded_output() -> Iterator[Output]:
    """Replace both output streams by ones that fall silent where they cannot be written.

    Yields that of the standard output.
    """
    before = sys.stdout, sys.stderr
    streams = [Output(stream if stream is not None else open_nowhere()) for stream in before]
    sys.stdout, sys.stderr = streams
    try:
        yield streams[0]
    finally:
        for stream in streams:
            stream.close_if_silent()
        sys.stdout, sys.stderr = before


def open_nowhere() -> TextIO:
    """Return a stream that takes everything, for a program that was started without one."""
    return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123


@contextlib.contextmanager
def ending_interrupts() -> Iterator[None]:
    """Treat a request to end (SIGTERM, SIGHUP) like Ctrl-C, unless it is ignored as under nohup."""

    def interrupt(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        raise KeyboardInterrupt

    own = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    with _handled(own, interrupt):
        yield


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Finish what is inside before a Ctrl-C, or a request to end, takes effect."""
    pending: list[int] = []
    with _handled(
        [signal.SIGINT, *_ENDING],
        lambda number, frame: pending.append(number),  # noqa: ARG005
    ):
        yield
    if pending:
        raise KeyboardInterrupt


@contextlib.contextmanager
def _handled(numbers: list[signal.Signals], handler: Any) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        numbers = []  # only the main thread can set handlers, and only it is interrupted
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
