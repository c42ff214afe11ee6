"""Run a text as ``python -c`` does, in a fork of the prewarmed process; see `tests/commands.py`."""

from __future__ import annotations

import sys

if __name__ == "__main__":
    text = sys.argv[1]
    sys.argv[:] = ["-c", *sys.argv[2:]]
    exec(compile(text, "<program>", "exec"), {"__name__": "__main__"})  # noqa: S102
