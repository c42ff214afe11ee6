"""Writers and followers in processes of their own, for benchmarks and stress."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import rtask


def make_writer(folder: Path, token_file: Path) -> str:
    """Make an empty knowledge base and a token for its followers; return a robot's token."""
    rtask.open(folder, ontologies=False, reason=False).close()
    right = ("--role", "reader", "--right", "replicate")
    token_file.write_text(_token(folder, *right), "utf-8")
    return _token(folder, "--robot", "nao-1")


def _token(folder: Path, *who: str) -> str:
    command = [sys.executable, "-m", "rtask", "token", "create", "-d", str(folder), *who]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def digest(folder: Path) -> tuple[int, str]:
    """Return the last commit and a digest of all statements of a folder that nobody serves."""
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        lines = sorted(map(str, kb.store.quads_for_pattern(None, None, None)))
        return kb.seq, hashlib.sha256("\n".join(lines).encode()).hexdigest()
