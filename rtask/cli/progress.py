"""Progress of slow work, on standard error: how far a load is, what is being computed, compilation.

Nothing is shown before two seconds have passed, nor where standard error is not a terminal.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, TextIO, cast

import click

__all__ = ["LoadProgress", "Working", "announce_compilation", "at_work"]

_QUIET_S = 2.0
_TICK_S = 0.5
_NAMELESS_S = 2.5  # later than a line that says what is being done
_CLEAR = "\r\x1b[K"


class Working:
    """Context manager that names what is being done once it has taken two seconds.

    Of several at a time only the one begun last is shown.

    Parameters
    ----------
    text
        What is being done, such as ``"checking the shapes"``.
    quiet_s
        How long to stay silent, s.

    Examples
    --------
    >>> with Working("adding two numbers"):
    ...     1 + 1
    2
    """

    _begun: ClassVar[list[Working]] = []

    def __init__(self, text: str, quiet_s: float = _QUIET_S) -> None:
        self._text, self._quiet_s = text, quiet_s
        self._done = threading.Event()
        self._writing = threading.Lock()
        self._shown = False
        self._thread = threading.Thread(target=self._tick, daemon=True)
        self._terminal = sys.stderr.isatty()
        self._share = ""

    def tell(self, done: int, total: int) -> None:
        """Take note of how much of the work is done, which is shown from then on."""
        self._share = f" {done / total:.0%}," if total else ""

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Remove the line while something else is printed; it comes back by itself."""
        with self._writing:
            self._clear()
            yield

    def __enter__(self) -> Working:
        self._started = time.monotonic()
        self._begun.append(self)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> float:
        """Remove the line; return how long the work took, s."""
        self._done.set()
        self._thread.join()
        self._begun.remove(self)
        return time.monotonic() - self._started

    def _tick(self) -> None:
        if not self._terminal or self._done.wait(self._quiet_s):
            return
        while True:
            with self._writing:
                seconds = time.monotonic() - self._started
                text = f"{_CLEAR}{self._text} ...{self._share} {seconds:.0f} s"
                if self._begun[-1] is self:
                    self._shown = True
                    click.echo(text, err=True, nl=False)
            if self._done.wait(_TICK_S):
                self._clear()
                return

    def _clear(self) -> None:
        if self._shown:
            self._shown = False
            click.echo(_CLEAR, err=True, nl=False)


class _Heard:
    """A stream that calls back before the first thing written to it, and passes everything on."""

    def __init__(self, stream: TextIO, on_first: Callable[[], None]) -> None:
        self._stream, self._on_first = stream, on_first

    def __getattr__(self, name: str) -> Any:
        if name in ("write", "writelines", "buffer", "fileno"):
            self._on_first()
        return getattr(self._stream, name)


@contextmanager
def at_work(name: str) -> Iterator[None]:
    """Show on a terminal that a command is at work until it says something itself.

    Parameters
    ----------
    name
        The command.
    """
    if not sys.stderr.isatty():
        yield
        return
    out, err = sys.stdout, sys.stderr
    line = _NamelessLine(f"{name} is at work", err)

    def first_word() -> None:
        line.close()
        if sys.stdout is heard_out:  # and not what somebody else put there for a while
            sys.stdout = out
        if sys.stderr is heard_err:
            sys.stderr = err

    heard_out, heard_err = (cast(TextIO, _Heard(stream, first_word)) for stream in (out, err))
    sys.stdout, sys.stderr = heard_out, heard_err
    try:
        yield
    finally:
        first_word()


class _NamelessLine:
    """A line with the seconds since a command began."""

    def __init__(self, text: str, stream: TextIO) -> None:
        self._text, self._stream = text, stream
        self._done = threading.Event()
        self._writing = threading.Lock()
        self._shown = False
        self._started = time.monotonic()
        threading.Thread(target=self._tick, daemon=True).start()

    def close(self) -> None:
        """Remove the line; nothing is written afterwards."""
        with self._writing:
            self._done.set()
            if self._shown:
                self._shown = False
                self._stream.write(_CLEAR)
                self._stream.flush()

    def _tick(self) -> None:
        wait_s = _NAMELESS_S
        while not self._done.wait(wait_s):
            with self._writing:
                if self._done.is_set():
                    return
                seconds = time.monotonic() - self._started
                self._shown = True
                self._stream.write(f"{_CLEAR}{self._text} ... {seconds:.0f} s")
                self._stream.flush()
            wait_s = _TICK_S


class LoadProgress:
    """Share of a document that has been read, its speed and the time left, on a terminal."""

    def __init__(self) -> None:
        self._started = self._shown = time.monotonic()
        self._name = ""
        self._before = 0

    def __call__(self, name: str, read: int, size: int) -> None:
        """Show how much of a document has been read, five times a second at most.

        Parameters
        ----------
        name
            File or address.
        read, size
            Bytes read so far, and bytes in all; 0 where the size is not known.
        """
        now = time.monotonic()
        if name != self._name or read < self._before:
            self._name, self._started = name, now
        self._before = read
        if now - self._shown < 0.2 or not size:
            return
        self._shown = now
        share = min(read / size, 1.0)
        rate = read / max(now - self._started, 1e-3)
        left = (size - read) / max(rate, 1.0)
        text = f"{Path(name).name[:40]} {share:4.0%} {rate / 1e6:.1f} MB/s, {left:.0f} s left"
        click.echo(f"{_CLEAR}{text}", err=True, nl=False)

    def clear(self) -> None:
        """Remove the line."""
        click.echo(_CLEAR, err=True, nl=False)


@contextmanager
def announce_compilation() -> Iterator[None]:
    """Tell the user while numeric kernels are compiled, which happens on the first run.

    The compiled code is cached on disk, so that later runs start at once and nothing is shown.
    """
    from numba.core import event

    class Listener(event.Listener):
        def __init__(self) -> None:
            self.depth = 0
            self.total_s = 0.0
            self.line: Working | None = None

        def on_start(self, event: object) -> None:
            self.depth += 1
            if self.depth == 1:
                text = "compiling numeric kernels, once on this machine"
                self.line = Working(text, quiet_s=max(_QUIET_S - self.total_s, 0.0))
                self.line.__enter__()

        def on_end(self, event: object) -> None:
            self.depth -= 1
            if self.depth == 0 and self.line is not None:
                self.total_s += self.line.close()
                self.line = None

    listener = Listener()
    events: Any = event  # numba's functions carry no types
    events.register("numba:compile", listener)
    try:
        yield
    finally:
        events.unregister("numba:compile", listener)
