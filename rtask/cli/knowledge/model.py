"""``rtask model``."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def model() -> None:
    """Python classes for ontologies."""


@model.command()
@click.argument("ontology", default="bundled")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; standard output if not given.",
)
def generate(ontology: str, out: Path | None) -> None:
    """Write typed classes for an ontology, so that editors and mypy know every field.

    ONTOLOGY is a file, a folder, a knowledge base's folder, or "bundled": the vocabulary of RTASK,
    as rtask.model.RTASK has it. Classes that RTASK has are taken from there.
    """
    from rtask.errors import UsageError
    from rtask.model.generate import generate_for, generate_rtask
    from rtask.ontology_docs import read_source

    text = generate_rtask() if ontology == "bundled" else generate_for(read_source(ontology))
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from error
    click.echo(f"wrote {out}")
