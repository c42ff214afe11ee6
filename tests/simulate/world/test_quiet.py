"""The terminal without the physics engine's greetings, and with everything else it prints."""

from __future__ import annotations

import ctypes
import subprocess
import sys

from simulate.world.quiet import without_banner

_EMPTY_WORLD = """
from simulate.world.world import World

World("fast")
"""


def test_a_world_opens_without_a_word() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _EMPTY_WORLD], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")


def test_what_is_not_a_banner_reaches_standard_error(capfd) -> None:
    with without_banner():
        ctypes.CDLL(None).puts(b"argv[0]=")
        ctypes.CDLL(None).puts(b"b3Warning: no inertia")
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err == "b3Warning: no inertia\n"
