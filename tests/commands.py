"""Commands of ``rtask`` as a shell runs them, each in a process of its own.

The process is a fork of one that has imported everything: a tenth of a second of processor time
instead of one to three. A test of what is imported, or of the interpreter's own start, runs
``python -m rtask`` instead.
"""

from __future__ import annotations

import atexit
import functools
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tests.prewarmed import ForkedProcess, Prewarmed

CommandProcess = subprocess.Popen[str] | ForkedProcess
_PATIENCE_S = 300.0  # a page of examples takes 20 s idle, and minutes beside seven others


@functools.cache
def _prewarmed() -> Prewarmed:
    """Return the process that forks; it is started with the first command."""
    made = Prewarmed()
    atexit.register(made.close)
    return made


def start_command(
    *arguments: str,
    environment: Mapping[str, str] | None = None,
    module: str = "rtask",
    folder: Path | None = None,
    stdin: int = subprocess.DEVNULL,
    stdout: int = subprocess.PIPE,
    stderr: int = subprocess.PIPE,
) -> CommandProcess:
    """Start ``rtask`` with these arguments; the caller ends it and closes its pipes.

    Parameters
    ----------
    *arguments
        Of the command.
    environment
        Of the process; none for this one's.
    module
        What is run, if not ``rtask``.
    folder
        Where it is run; none for the current folder.
    stdin, stdout, stderr
        As :class:`subprocess.Popen` takes them.
    """
    environment = os.environ if environment is None else environment
    if Prewarmed.is_possible():
        return _prewarmed().start(
            arguments, environment, module=module, folder=folder,
            stdin=stdin, stdout=stdout, stderr=stderr,
        )  # fmt: skip
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env={**environment, "PYTHONUNBUFFERED": "1"}, cwd=folder, text=True,
        stdin=stdin, stdout=stdout, stderr=stderr,
    )  # fmt: skip


def run_program(
    text: str,
    *arguments: str,
    given: str = "",
    check: bool = False,
    folder: Path | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program as ``python -c`` does, to its end; see :func:`run_command`.

    A program whose imports are what is tested is run by the interpreter itself.
    """
    return run_command(
        text, *arguments, module="tests.program", given=given, check=check, folder=folder
    )


def run_command(
    *arguments: str,
    environment: Mapping[str, str] | None = None,
    module: str = "rtask",
    given: str = "",
    folder: Path | None = None,
    timeout: float = _PATIENCE_S,
    check: bool = False,
) -> subprocess.CompletedProcess[str]:
    """Run ``rtask`` with these arguments to its end, and return what it printed.

    Parameters
    ----------
    *arguments
        Of the command.
    environment
        Of the process; none for this one's.
    module
        What is run, if not ``rtask``.
    given
        What it reads from its standard input.
    folder
        Where it is run; none for the current folder.
    timeout
        Seconds after which it is ended.
    check
        Whether an exit code other than 0 is an error.

    Raises
    ------
    subprocess.TimeoutExpired
        It did not end in time.
    subprocess.CalledProcessError
        It ended with another code than 0, and ``check`` was set.
    """
    with (
        tempfile.TemporaryFile("w+") as input_,
        tempfile.TemporaryFile("w+") as printed,
        tempfile.TemporaryFile("w+") as errors,
    ):
        input_.write(given)
        input_.seek(0)
        process = start_command(
            *arguments, environment=environment, module=module, folder=folder,
            stdin=input_.fileno(), stdout=printed.fileno(), stderr=errors.fileno(),
        )  # fmt: skip
        try:
            code = process.wait(timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        printed.seek(0)
        errors.seek(0)
        done = subprocess.CompletedProcess(
            ["rtask", *arguments], code, printed.read(), errors.read()
        )
    if check:
        done.check_returncode()
    return done
