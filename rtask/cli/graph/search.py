"""``rtask search``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json, term


@click.command()
@click.argument("words", nargs=-1, required=True)
@data_option
@click.option("--class", "-c", "cls", help="Only instances of this class.")
@click.option("--lang", help="Only texts in this language, e.g. en.")
@click.option("--limit", "-n", default=20, show_default=True, help="At most so many.")
@json_option
def search(
    words: tuple[str, ...], data: Path, cls: str | None, lang: str | None, limit: int, as_json: bool
) -> None:
    """Find things by the words of their labels, comments and descriptions.

    All WORDS must be there; "cup*" stands for any ending.
    """
    with open_to_read(data) as kb:
        wanted = None if cls is None else term(cls, kb.base)
        found = kb.search(" ".join(words), cls=wanted, lang=lang, limit=limit)
    if as_json:
        print_json(
            [
                {"iri": h.subject.value, "text": h.text, "language": h.language, "score": h.score}
                for h in found
            ]
        )
        return
    for hit in found:
        tag = f"@{hit.language}" if hit.language else ""
        text = " ".join(hit.text.split())
        click.echo(f"{hit.subject.value}  {text[:100]}{tag}")
