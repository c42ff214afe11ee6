"""Options and errors that all commands share which plan grasps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from rtask.cli.options import announce_undo
from rtask.errors import RtaskError, UsageError

__all__ = ["announce_stored", "errors_name", "make_plot_folder", "seed_option"]

seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Random seed of the perturbations.",
)


def make_plot_folder(folder: Path) -> None:
    """Create the folder for drawings before anything is planned."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--save-plots {folder}: {error.strerror}") from error


def announce_stored(stored: Mapping[str, Any]) -> None:
    """Print what was stored of a plan, and how to undo it."""
    many = f"{len(stored['grasps'])} grasps"
    if not stored["commit"]:
        click.echo(f"the object has these {many} already")
        return
    click.echo(f"stored {many} as {stored['commit']}")
    announce_undo("undo", stored["commit"])


@contextmanager
def errors_name(source: str) -> Iterator[None]:
    """Turn errors of a planner into one line that names the source."""
    try:
        yield
    except ValueError as error:
        if isinstance(error, RtaskError):
            raise
        raise UsageError(f"{source}: {error}") from error
    except BrokenPipeError:  # of the reader of what is printed
        raise
    except OSError as error:
        raise UsageError(f"{error.filename or source}: {error.strerror or error}") from error
