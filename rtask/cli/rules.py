"""``rtask rules``: add, list, show and remove rules of the user."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.changing.new_folder import open_or_make
from rtask.cli.connection import open_to_change, open_to_read, reasoner_of
from rtask.cli.options import (
    agent_option,
    announce_undo,
    data_option,
    json_option,
    listing_option,
    print_json,
    print_listing,
    server_option,
)
from rtask.cli.progress import announce_compilation
from rtask.cli.things import name_or_iri

if TYPE_CHECKING:
    from rtask.client.reasoner import ReasonerClient
    from rtask.kb.rules.rule import Rule


@click.group()
def rules() -> None:
    """Add, list, show and remove rules of the user."""


@rules.command()
@click.argument("sources", nargs=-1, required=True, metavar="FILE...")
@data_option
@server_option
@click.option("--label", metavar="LABEL", help="Label of the rule, where there is one FILE or -.")
@click.option("--replace", is_flag=True, help="Replace rules of the same label.")
@agent_option(
    "The author, who needs the right to add rules; a server knows it by the token.  "
    "[default: the operator]"
)
@json_option
def add(
    sources: tuple[str, ...],
    data: Path,
    server: str | None,
    label: str | None,
    replace: bool,
    agent: str | None,
    as_json: bool,
) -> None:
    """Add rules from files or folders; - reads one rule from standard input.

    A rule is a SPARQL CONSTRUCT query. It is labelled with the file's name or, where a file holds
    several, by the line "# rule: LABEL" before each. What follows from the rules is derived in the
    same commit, from now on with every commit, and named by their labels in proofs.
    """
    import dataclasses
    import sys

    import rtask
    from rtask.errors import UsageError
    from rtask.kb.rules.rule import read_rules

    parsed: list[Rule] = []
    for source in sources:
        if source == "-":
            if not label:
                raise UsageError("a rule from standard input needs --label")
            parsed.append(rtask.Rule(label, sys.stdin.read()))
        else:
            parsed += read_rules(Path(source))
    if label:
        if len(parsed) != 1:
            raise UsageError(f"--label is for one rule, not {len(parsed)}")
        parsed = [dataclasses.replace(parsed[0], label=label)]
    if server:
        with _connected(server, agent) as client:
            present = client.rules()
            made = client.add(parsed, replace)
            facts = {name: made[name] for name in ("commit", "derived", "changed")}
    else:
        with announce_compilation(), open_or_make(data) as kb:
            present = kb.rules()
            commit = kb.add_rules(parsed, agent, replace=replace)
        facts = {"commit": commit.seq, "derived": commit.derived, "changed": commit.added > 0}
    new = _new(parsed, present)
    if as_json:
        print_json({"rules": [rule.label for rule in parsed], **facts})
    elif facts["changed"]:
        click.echo(f"{_counted(len(new))} added, {facts['derived']} statements derived")
        if {rule.label for rule in new} & {rule.label for rule in present}:
            announce_undo("undo", str(facts["commit"]))
        else:
            announce_undo("rules", "remove", *(rule.label for rule in new))
    else:
        click.echo("nothing new: these rules are there already")


@rules.command("list")
@data_option
@server_option
@listing_option
@json_option
def list_rules(data: Path, server: str | None, limit: int | None, as_json: bool) -> None:
    """List the rules of the user with author and date."""
    print_listing(
        _present(data, server),
        limit,
        as_json,
        lambda rule: f"{rule.label:32s} {_origin(rule)}  {rule.comment}".rstrip(),
        "no rules of a user yet; `rtask rules add` adds one",
        to_data=lambda rule: rule.to_dict(),
    )


@rules.command()
@click.argument("name", metavar="LABEL")
@data_option
@server_option
@json_option
def show(name: str, data: Path, server: str | None, as_json: bool) -> None:
    """Show the text of a rule, named by label or IRI."""
    from rtask.kb.rules.rulebook import find

    stored = _present(data, server)
    rule_iri = find(stored, name_or_iri(name, data, server))
    rule = next(rule for rule in stored if rule.iri == rule_iri)
    if as_json:
        print_json(rule.to_dict())
    else:
        click.echo(f"# rule: {rule.label}\n# {_origin(rule)}\n{rule.text}")


@rules.command()
@click.argument("names", nargs=-1, required=True, metavar="LABEL...")
@data_option
@server_option
@agent_option(
    "Who removes it, with the right to; a server knows it by the token.  [default: the operator]"
)
@json_option
def remove(
    names: tuple[str, ...], data: Path, server: str | None, agent: str | None, as_json: bool
) -> None:
    """Remove rules, named by label or IRI, with what followed from them alone."""
    names = tuple(name_or_iri(name, data, server) for name in names)
    if server:
        with _connected(server, agent) as client:
            made = client.remove(names)
            seq, gone = made["commit"], made["withdrawn"]
    else:
        with announce_compilation(), open_to_change(data) as kb:
            commit = kb.remove_rules(names, agent)
            seq, gone = commit.seq, commit.withdrawn
    if as_json:
        print_json({"removed": list(names), "commit": seq, "withdrawn": gone})
    else:
        click.echo(f"{_counted(len(names))} removed, {gone} derived statements withdrawn")
        announce_undo("undo", str(seq))


def _present(data: Path, server: str | None) -> list[Rule]:
    """Return the rules of a folder or a server."""
    if server:
        with _connected(server) as client:
            return client.rules()
    with open_to_read(data) as kb:
        return kb.rules()


def _new(rules: list[Rule], present: list[Rule]) -> list[Rule]:
    """Return the rules that are not there yet, or with another text."""
    from rtask.kb.rules.checking import tidy

    existing = {(rule.label, rule.text, rule.comment) for rule in present}
    return [
        candidate
        for candidate in map(tidy, rules)
        if (candidate.label, candidate.text, candidate.comment) not in existing
    ]


def _connected(server: str, agent: str | None = None) -> ReasonerClient:
    from rtask.errors import UsageError

    if agent:
        raise UsageError("--agent is for a folder; a server knows who asks by RTASK_TOKEN")
    return reasoner_of(server)


def _counted(number: int) -> str:
    return f"{number} rule{'' if number == 1 else 's'}"


def _origin(rule: Rule) -> str:
    author = rule.author.value.rpartition("/")[2] if rule.author else "operator"
    return f"{author:16s} {rule.time:%Y-%m-%d %H:%M}" if rule.time else author
