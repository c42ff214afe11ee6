"""The command ``rtask``: a group that imports a command only when it is called.

Other packages add commands through the entry-point group ``rtask.commands``.
"""

from __future__ import annotations

import ast
import difflib
import importlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import click

from rtask.cli.progress import at_work
from rtask.errors import RtaskError
from rtask.extras import naming_extras

__all__ = ["cli", "main"]

_BUILT_IN = {
    "ask": "rtask.cli.asking.ask:ask",
    "backup": "rtask.cli.maintenance:backup",
    "camera": "rtask.cli.perception.camera:camera",
    "contributors": "rtask.cli.people:contributors",
    "dataset": "rtask.cli.services.datasets:dataset",
    "doctor": "rtask.cli.doctor:doctor",
    "entails": "rtask.cli.entails:entails",
    "episodes": "rtask.cli.episodes:episodes",
    "branch": "rtask.cli.changing.branches:branch",
    "explain": "rtask.cli.reasoning:explain",
    "export": "rtask.cli.contents:export",
    "feedback": "rtask.cli.people:feedback",
    "grasp": "rtask.cli.grasping.group:grasp",
    "history": "rtask.cli.contents:history",
    "learn": "rtask.cli.grasping.learning:learn",
    "load": "rtask.cli.load:load",
    "mcp": "rtask.cli.agents:mcp",
    "migrate": "rtask.cli.world.migrate:migrate",
    "model": "rtask.cli.ontology:model",
    "objects": "rtask.cli.objects:objects",
    "ontology": "rtask.cli.ontology:ontology",
    "proposals": "rtask.cli.proposals:proposals",
    "quarantine": "rtask.cli.maintenance:quarantine",
    "query": "rtask.cli.query:query",
    "questions": "rtask.cli.tasks.questions:questions",
    "reason": "rtask.cli.reasoning:reason",
    "rebuild": "rtask.cli.maintenance:rebuild",
    "recognise": "rtask.cli.perception.recognise:recognise",
    "plan": "rtask.cli.tasks.plan:plan",
    "promote": "rtask.cli.maintenance:promote",
    "restore": "rtask.cli.maintenance:restore",
    "ros": "rtask.cli.ros.commands:ros",
    "ros2": "rtask.cli.ros2.commands:ros2",
    "rules": "rtask.cli.rules:rules",
    "search": "rtask.cli.query:search",
    "segment": "rtask.cli.perception.segment:segment",
    "service": "rtask.cli.services.calling:service",
    "stats": "rtask.cli.contents:stats",
    "tasks": "rtask.cli.tasks.queue:tasks",
    "teach": "rtask.cli.perception.teach:teach",
    "undo": "rtask.cli.changing.undo:undo",
    "update": "rtask.cli.query:update",
    "validate": "rtask.cli.maintenance:validate",
    "verify": "rtask.cli.maintenance:verify",
    "where": "rtask.cli.world.where:where",
    "why": "rtask.cli.tasks.why:why",
    "world": "rtask.cli.world.export:world",
    "worker": "rtask.cli.services.worker:worker",
}


_SECTIONS = {
    "Run": ("demo", "serve", "worker", "simulate", "study", "thesis"),
    "Ask": (
        "ask", "plan", "tasks", "questions", "query", "search", "explain", "entails", "why",
        "where", "history", "objects",
    ),
    "Load and change": (
        "load", "update", "undo", "branch", "export", "ontology", "rules", "model",
        "world",
    ),
    "Teach and recognise": ("teach", "recognise", "segment", "camera"),
    "Grasp and learn": ("grasp", "learn"),
    "Judge": ("feedback", "contributors", "episodes"),
    "Robots and services": ("robot", "ros", "ros2", "service", "dataset", "mcp"),
    "Look after": (
        "doctor", "stats", "token", "validate", "reason", "quarantine", "proposals", "verify",
        "rebuild", "migrate", "backup", "restore", "promote", "help",
    ),
}  # fmt: skip
"""Sections of the help, by what one wants to do; a command of another package comes last."""
_EXIT_CODES = {400: 2, 404: 1, 405: 2}
"""Exit codes by HTTP status, where a server names no kind of error."""


@cache
def _targets() -> Mapping[str, str]:
    """Return where each command is defined, as ``module:attribute``.

    What is installed is read once: that takes longer than most commands.
    """
    targets = dict(_BUILT_IN)
    for entry in importlib.metadata.entry_points(group="rtask.commands"):
        targets.setdefault(entry.name, entry.value)
    return targets


class LazyGroup(click.Group):
    """A group that knows its commands by name and imports each when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return all names, sorted."""
        return sorted({*_targets(), *self.commands})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; ``None`` if there is none of that name."""
        target = _targets().get(cmd_name)
        if target is None:
            return super().get_command(ctx, cmd_name)
        module, _, attribute = target.partition(":")
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command, or suggest one with a similar name."""
        name = args[0]
        if self.get_command(ctx, name) is None and not name.startswith("-"):
            near = difflib.get_close_matches(name, self.list_commands(ctx), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            ctx.fail(f"No such command {name!r}.{hint}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands by purpose with first lines of docstrings, importing none."""
        targets = _targets()
        grouped = {name for names in _SECTIONS.values() for name in names}
        others = sorted({*targets, *self.commands} - grouped)
        for title, names in {**_SECTIONS, "Others": others}.items():
            rows = [
                (name, self._summary(name, targets)) for name in names if self._has(name, targets)
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def _has(self, name: str, targets: Mapping[str, str]) -> bool:
        return name in targets or name in self.commands

    def _summary(self, name: str, targets: Mapping[str, str]) -> str:
        if name in targets:
            return short_help(targets[name])
        return (self.commands[name].help or "").partition("\n")[0]


def short_help(target: str) -> str:
    """Return the first line of a command's docstring, read from its source.

    >>> short_help("rtask.cli.contents:stats")
    'Count triples, graphs and commits.'
    """
    module, _, attribute = target.partition(":")
    try:
        spec = importlib.util.find_spec(module)
    except ImportError:
        spec = None
    if spec is None or spec.origin is None:
        return "(not installed)"
    for node in ast.parse(Path(spec.origin).read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == attribute:
            return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="rtask-kg", prog_name="rtask")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("--verbose", "-v", is_flag=True, help="Log what is being done.")
@click.pass_context
def cli(ctx: click.Context, debug: bool, verbose: bool) -> None:
    """A knowledge graph that robots share."""
    ctx.obj = {"debug": debug}
    if verbose or debug:
        import logging

        level = logging.DEBUG if debug else logging.INFO
        logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s")


@cli.command("help")
@click.argument("names", metavar="[COMMAND]...", nargs=-1)
@click.pass_context
def _help(ctx: click.Context, names: tuple[str, ...]) -> None:
    """Show the help of a command, such as `rtask help ontology diff`."""
    context = ctx.find_root()
    for name in names:
        group = context.command
        if not isinstance(group, click.Group):
            raise click.UsageError(f"{context.command_path} has no commands of its own")
        child = group.get_command(context, name)
        if child is None:
            near = difflib.get_close_matches(name, group.list_commands(context), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise click.UsageError(f"{context.command_path} has no command {name!r}.{hint}")
        context = child.make_context(name, [], parent=context, resilient_parsing=True)
    click.echo(context.get_help())


def _command_name(arguments: Sequence[str]) -> str:
    """Return ``rtask`` with the command that the arguments begin with."""
    return " ".join(["rtask", *(word for word in arguments if not word.startswith("-"))][:2])


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; an error is one line and an exit code, without a traceback."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with naming_extras(_command_name(given)), at_work(_command_name(given)):
            done: Any = cli.main(args=given, prog_name="rtask", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except click.Abort:
        click.echo("interrupted", err=True)
        sys.exit(130)
    except RtaskError as error:
        if "--debug" in given:
            raise
        click.echo(f"rtask: {_printable(str(error))}{_advice(error)}", err=True)
        sys.exit(_exit_code_of(error))
    except UnicodeEncodeError as error:  # an argument that is not UTF-8, or a terminal of another
        if "--debug" in given:
            raise
        there = error.object[max(error.start - 20, 0) : error.end + 20]
        click.echo(f"rtask: {there!r} cannot be written in {error.encoding}", err=True)
        sys.exit(2)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        if "--debug" in given:
            raise
        where = "" if error.filename is None else f"{error.filename}: "
        click.echo(f"rtask: {_printable(f'{where}{error.strerror or error}')}", err=True)
        # A path of the call that is not there is a wrong call; one of our own, a failure.
        is_absent = isinstance(error, (FileNotFoundError, IsADirectoryError, NotADirectoryError))
        sys.exit(2 if is_absent and str(error.filename) in given else RtaskError.exit_code)
    sys.exit(done if isinstance(done, int) else 0)


def _exit_code_of(error: RtaskError) -> int:
    """Return the exit code for an error, alike on a graph in this process and on a server.

    The answer of a server names the kind of error (RFC 9457, "type"), or has at least a status.

    Examples
    --------
    >>> from rtask.errors import CallFailedError, StoreLockedError
    >>> _exit_code_of(CallFailedError("no", http_status=422, problem="unknown-term"))
    1
    >>> _exit_code_of(CallFailedError("no", http_status=400)), _exit_code_of(StoreLockedError("no"))
    (2, 3)
    """
    if "http_status" not in error.details:
        return error.exit_code
    by_status = _EXIT_CODES.get(error.answer_status, error.exit_code)
    return _exit_codes(RtaskError).get(str(error.details.get("problem")), by_status)


def _exit_codes(kind: type[RtaskError]) -> dict[str, int]:
    """Return the exit codes of a class of errors and all below it, by slug."""
    codes = {kind.slug: kind.exit_code}
    for each in kind.__subclasses__():
        codes |= _exit_codes(each)
    return codes


def _printable(text: str) -> str:
    r"""Return a message whose quotes of a file do not steer the terminal.

    >>> _printable("no DXF: \x1b[2J")
    'no DXF: \\x1b[2J'
    """
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def _advice(error: RtaskError) -> str:
    """Return where a knowledge base is, or how to make one, if the folder named holds none."""
    if not error.details.get("absent"):
        return ""
    here = Path.cwd()
    bases = sorted({*here.glob("*/kb.json"), *here.glob("*/*/kb.json")})
    if not bases:
        return "; `rtask load` makes one"
    return f"; there is one here: --data {bases[0].parent.relative_to(here)}"
