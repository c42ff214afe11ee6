"""Progress of slow work on a terminal: the share that is done, and only while it lasts."""

from __future__ import annotations

import io
import threading
from contextlib import redirect_stderr

from rtask.cli.progress import Working

CLEAR = "\r\x1b[K"
_WAIT_S = 60.0


class Terminal(io.StringIO):
    """A stream that claims to be a terminal, and on which one can wait for words."""

    def __init__(self) -> None:
        super().__init__()
        self._changed = threading.Condition()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        with self._changed:
            self._changed.notify_all()
            return super().write(text)

    def expect(self, words: str, times: int = 1) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: self.getvalue().count(words) >= times, _WAIT_S)


def test_the_share_that_is_done_stands_in_the_line_until_the_work_ends() -> None:
    with redirect_stderr(Terminal()) as terminal, Working("counting sheep", 0.0) as working:
        terminal.expect("counting sheep ... ")
        working.tell(1, 4)
        terminal.expect("counting sheep ... 25%, ")
        working.tell(3, 4)
        terminal.expect("counting sheep ... 75%, ")
    assert terminal.getvalue().endswith(CLEAR)


def test_the_line_makes_way_for_what_is_printed_meanwhile() -> None:
    with redirect_stderr(Terminal()) as terminal, Working("counting", 0.0) as working:
        terminal.expect("counting ... ")
        with working.aside():
            assert terminal.getvalue().endswith(CLEAR)
            working.tell(1, 2)
            terminal.write("a black one\n")
        terminal.expect(f"{CLEAR}a black one\n{CLEAR}counting ... 50%, ")


def test_of_two_lines_the_inner_one_is_shown() -> None:
    with redirect_stderr(Terminal()) as terminal, Working("planning", 0.0) as outer:
        terminal.expect("planning ... ")
        with Working("compiling", 0.0):
            outer.tell(1, 2)
            terminal.expect("compiling ... ", times=3)
            assert "50%" not in terminal.getvalue()
        terminal.expect("planning ... 50%, ")


def test_no_terminal_is_told_nothing() -> None:
    with redirect_stderr(io.StringIO()) as pipe, Working("counting", 0.0) as working:
        working.tell(1, 2)
        with working.aside():
            pass
    assert pipe.getvalue() == ""
