"""``rtask load``: read files and ontologies into a knowledge base."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.changing.new_folder import open_or_make
from rtask.cli.options import (
    announce_final,
    announce_undo,
    data_option,
    json_option,
    print_json,
    resource,
    shapes_option,
)
from rtask.cli.progress import LoadProgress
from rtask.errors import InconsistentError

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase
    from rtask.loader.report import FileReport, LoadReport

_MAX_READ_AGAIN = 200_000
"""Statements of a load that are read from the journal to tell whether they can be undone."""


@click.command()
@click.argument("sources", nargs=-1)
@data_option
@click.option("--graph", "-g", help="IRI of the graph to load into.")
@click.option(
    "--format",
    "-F",
    "form",
    help="Format: turtle, rdfxml, jsonld, functional ...  [default: by name and content]",
)
@click.option("--base", help="Base for relative IRIs.")
@click.option(
    "--catalog",
    "catalogs",
    multiple=True,
    type=click.Path(exists=True, path_type=Path),
    help="Folder or catalogue file to look up imports in first; may be repeated.",
)
@click.option("--replace", is_flag=True, help="Remove what the graph held before.")
@click.option(
    "--missing-imports",
    type=click.Choice(["error", "warn", "ignore"]),
    default="error",
    show_default=True,
    help="What to do about an import that cannot be found.",
)
@click.option(
    "--no-patches",
    is_flag=True,
    help="Keep known faults of published ontologies (`rtask ontology patches` lists them).",
)
@click.option("--no-reason", is_flag=True, help="Skip reasoning; the next open catches up.")
@click.option("--dry-run", is_flag=True, help="Read, resolve and count, but store nothing.")
@click.option(
    "--validate",
    type=click.Choice(["off", "warn", "refuse"]),
    default="off",
    show_default=True,
    help="Check the statements against the SHACL shapes.",
)
@shapes_option
@click.option(
    "--on-inconsistency",
    type=click.Choice(["error", "quarantine"]),
    default="error",
    show_default=True,
    help="Refuse a file that contradicts itself or the graph, or set the statements to blame "
    "aside (`rtask quarantine`) and store the rest.",
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
    no_patches: bool,
    no_reason: bool,
    dry_run: bool,
    validate: str,
    shapes: tuple[Path, ...],
    on_inconsistency: str,
    as_json: bool,
) -> None:
    """Load files, folders, - (standard input) or IRIs of known ontologies.

    The knowledge base is created if it does not exist. Each file is one commit: it is stored as a
    whole or not at all. Without SOURCES, a new knowledge base is created with the ontology that
    comes with RTASK.
    """
    reports: list[LoadReport] = []
    progress = LoadProgress() if sys.stderr.isatty() and not as_json else None
    if shapes and validate == "off":
        validate = "refuse"
    options = {
        "reason": not no_reason,
        "validate": validate,
        "shapes": shapes,
        "on_inconsistency": on_inconsistency,
    }
    with _hinting(on_inconsistency), open_or_make(data, stores=not dry_run, **options) as kb:
        graph = None if graph is None else resource(graph, kb.base)
        before = {str(name) for name in kb.store.named_graphs()}
        seq, aside = kb.seq, len(kb.quarantined())
        try:
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
                    patches=not no_patches,
                )
                reports.append(report)
                if progress is not None:
                    progress.clear()
                if not as_json:
                    _print_report(report)
        finally:  # what was stored before a source that fails stays, and can be undone
            if not as_json and not dry_run:
                _announce_undo(kb, reports, before, seq)
        aside = len(kb.quarantined()) - aside
    if aside > 0:
        click.echo(
            f"{aside} statements contradict the rest and were set aside; "
            f"to list them: rtask quarantine --data {data}",
            err=True,
        )
    if as_json:
        print_json([report.to_dict() for report in reports])


@contextmanager
def _hinting(on_inconsistency: str) -> Iterator[None]:
    """Add what a person at a terminal may do to the refusal of contradictory statements."""
    try:
        yield
    except InconsistentError as error:
        # What a removal makes contradictory is refused in either way.
        if on_inconsistency == "error":
            error.args = (f"{error}, and --on-inconsistency quarantine stores what does not clash",)
        raise


def _print_report(report: LoadReport) -> None:
    """Print what became of a source: a line for each file, and what was mended or is missing."""
    for file in report.files:
        where = f" -> {file.graph}" if file.graph else ""
        click.echo(
            f"{file.name}: {file.format}, {file.read} statements, +{file.added} "
            f"-{file.removed}, {file.derived} derived, {file.seconds:.2f} s{where}"
        )
    for file in report.files:
        for name in file.patches:
            click.echo(f"{file.name}: mended by the patch {name}", err=True)
    for name in report.missing_imports:
        click.echo(f"missing import: {name}", err=True)
    for name in report.undeclared:
        click.echo(f"unknown term: {name}", err=True)
    for text in report.warnings:
        click.echo(f"warning: {text}", err=True)


def _announce_undo(
    kb: KnowledgeBase, reports: list[LoadReport], before: set[str], seq: int
) -> None:
    """Print how to remove new graphs, and how to undo the commits where a graph had statements.

    Parameters
    ----------
    before
        The graphs that there were.
    seq
        Number of the last commit before.
    """
    from rtask.rdf.namespaces import RDF
    from rtask.rdf.terms import iri

    ontology_class = iri("http://www.w3.org/2002/07/owl#Ontology")
    changing = [file for report in reports for file in report.files if file.added or file.removed]
    if any(not file.graph or f"<{file.graph}>" in before for file in changing):
        _announce_undo_of_commits(kb, changing, seq)
        return
    for graph in dict.fromkeys(file.graph for file in changing):
        if kb.match(None, RDF.type, ontology_class, graph):
            announce_undo("ontology", "unload", graph)
        else:
            announce_undo("update", f"DROP GRAPH <{graph}>")


def _announce_undo_of_commits(kb: KnowledgeBase, files: list[FileReport], seq: int) -> None:
    changed = sum(file.added + file.removed for file in files)
    entries = kb.history(since=seq) if changed <= _MAX_READ_AGAIN else []
    if sum(len(entry.added) + len(entry.removed) for entry in entries) == changed:
        announce_undo("undo", *(str(entry.seq) for entry in reversed(entries)))
        return
    announce_final(f"{changed} statements went into graphs that had some; see the latest backup")
