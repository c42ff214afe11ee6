"""``rtask load``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, print_json


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
    as_json: bool,
) -> None:
    """Load files, folders, - (standard input) or IRIs of known ontologies.

    The knowledge base is made if it does not exist. Each file is one commit: wholly or not at
    all. Without SOURCES a new knowledge base gets the ontology that comes with RTASK.
    """
    import rtask

    reports = []
    with rtask.open(data, reason=not no_reason) as kb:
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
            )
            reports.append(report)
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
    if as_json:
        print_json([report.to_dict() for report in reports])
