"""``rtask load``."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, print_json


class Progress:
    """One line on a terminal: document, share that is read, time that is left."""

    def __init__(self) -> None:
        self._started = self._shown = time.monotonic()
        self._name = ""
        self._before = 0

    def __call__(self, name: str, read: int, size: int) -> None:
        """Show how far it is; five times a second at most."""
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
        click.echo(f"\r\x1b[K{text}", err=True, nl=False)

    def clear(self) -> None:
        """Take the line away."""
        click.echo("\r\x1b[K", err=True, nl=False)


@click.command()
@click.argument("sources", nargs=-1)
@data_option
@click.option("--graph", "-g", help="IRI of the graph that takes the statements.")
@click.option("--format", "-f", "form", help="turtle, rdfxml, jsonld, functional ...")
@click.option("--base", help="IRI against which relative IRIs are resolved.")
@click.option(
    "--catalog",
    "catalogs",
    multiple=True,
    type=click.Path(exists=True, path_type=Path),
    help="Folder or catalogue file in which imports are looked up first.",
)
@click.option("--replace", is_flag=True, help="Withdraw what the graph held before.")
@click.option(
    "--missing-imports",
    type=click.Choice(["error", "warn", "ignore"]),
    default="error",
    show_default=True,
    help="What to do about an import that no place has.",
)
@click.option("--no-reason", is_flag=True, help="Derive nothing; the next open does.")
@click.option("--dry-run", is_flag=True, help="Read, resolve and count, store nothing.")
@click.option(
    "--validate",
    type=click.Choice(["off", "warn", "refuse"]),
    default="off",
    show_default=True,
    help="Hold the statements against the SHACL shapes.",
)
@json_option
def load(
    sources: tuple[str, ...],
    data: Path,
    graph: str | None,
    form: str | None,
    base: str | None,
    catalogs: tuple[Path, ...],
    replace: bool,
    missing_imports: str,
    no_reason: bool,
    dry_run: bool,
    validate: str,
    as_json: bool,
) -> None:
    """Load files, folders, - (standard input) or IRIs of known ontologies.

    The knowledge base is made if it does not exist. Each file is one commit: wholly or not at
    all. Without SOURCES a new knowledge base gets the ontology that comes with RTASK.
    """
    import rtask

    reports = []
    progress = Progress() if sys.stderr.isatty() and not as_json else None
    with rtask.open(data, reason=not no_reason, validate=validate) as kb:
        for source in sources:
            report = kb.load(
                source,
                format=form,
                graph=graph,
                base=base,
                catalogs=catalogs,
                replace=replace,
                missing_imports=missing_imports,
                dry_run=dry_run,
                on_read=progress,
            )
            reports.append(report)
            if progress is not None:
                progress.clear()
            if as_json:
                continue
            for file in report.files:
                where = f" -> {file.graph}" if file.graph else ""
                click.echo(
                    f"{file.name}: {file.format}, {file.read} statements, +{file.added} "
                    f"-{file.removed}, {file.derived} derived, {file.seconds:.2f} s{where}"
                )
            for name in report.missing_imports:
                click.echo(f"missing import: {name}", err=True)
            for name in report.undeclared:
                click.echo(f"nothing is known of {name}", err=True)
            for text in report.warnings:
                click.echo(f"warning: {text}", err=True)
    if as_json:
        print_json([report.to_dict() for report in reports])
