"""Commands that keep a knowledge base in order: copy it, check it, rebuild what is derived."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import open_to_change, open_to_read
from rtask.cli.options import (
    announce_final,
    confirm_final,
    data_option,
    json_option,
    listing_option,
    print_json,
    shapes_option,
    shown_rows,
    yes_option,
)
from rtask.cli.progress import Working, announce_compilation
from rtask.cli.things import name_or_iri
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.kb.commit.validation import Violation
    from rtask.knowledge_base import KnowledgeBase

_FILES = ("store", "journal")
_READ = "words"
"""Is read from pictures, by an extra: not part of "all"."""
_PARTS = ("union", "catalogue", "inferred", "index", "statistics", "recognition", "models", "blobs")


@click.command()
@click.argument("target", type=click.Path(path_type=Path))
@data_option
@json_option
def backup(target: Path, data: Path, as_json: bool) -> None:
    """Copy a knowledge base to TARGET, a new folder that opens by itself."""
    with Working("copying"), open_to_change(data, ontologies=False, reason=False) as kb:
        record = kb.backup(target)
    if as_json:
        print_json({"target": str(target), **record})
    else:
        click.echo(f"{target}: commit {record['seq']}")


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@json_option
def restore(source: Path, target: Path, as_json: bool) -> None:
    """Restore the backup SOURCE to TARGET, a new folder."""
    from rtask.kb.maintenance.backup import restore as restore_backup

    with Working("copying"):
        record = restore_backup(source, target)
    if as_json:
        print_json({"target": str(target), **record})
    else:
        click.echo(f"{target}: commit {record['seq']} of {record['created']}")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@yes_option
@json_option
def promote(folder: Path, yes: bool, as_json: bool) -> None:
    """Make the follower in FOLDER a knowledge base of its own, which takes writes.

    Its numbering of commits begins a new epoch, so that other followers start over from it. Stop
    the former writer first: nothing keeps it from going on.
    """
    import rtask
    from rtask.kb.maintenance import replica

    if replica.followed_by(folder) is None:
        raise UsageError(f"{folder} follows nobody; it can be served as it is")
    confirm_final("the copy will not follow again; a new follower starts over", yes)
    with Working("recovering"):
        rtask.open(folder, ontologies=False, reason=False).close()
    settings = replica.promote(folder)
    if as_json:
        print_json({"folder": str(folder), "epoch": settings.epoch})
        return
    click.echo(f"{folder}: epoch {settings.epoch}; serve it: rtask serve -d {folder}")


@click.command()
@data_option
@click.option("--repair", is_flag=True, help="Rebuild derived data that are wrong.")
@listing_option
@json_option
def verify(data: Path, repair: bool, limit: int | None, as_json: bool) -> None:
    """Check derived data against the graph, and blobs against their digests.

    Exit code 1 if there is an error; with --repair, if one remains.
    """
    with Working("checking derived data and blobs"):
        if repair:
            with open_to_change(data, ontologies=False) as kb:
                findings = kb.verify(repair=True)
                left = kb.verify()
        else:
            with open_to_read(data) as kb:
                left = findings = kb.verify()
    shown = shown_rows(findings, limit, as_json)
    if as_json:
        print_json([asdict(finding) for finding in shown])
    else:
        for finding in shown:
            click.echo(f"{finding.severity:6s} {finding.part:10s} {finding.detail}")
        if not findings:
            click.echo("all well")
    if any(finding.severity == "error" for finding in left):
        raise SystemExit(1)


@click.command()
@data_option
@shapes_option
@listing_option
@json_option
def validate(data: Path, shapes: tuple[Path, ...], limit: int | None, as_json: bool) -> None:
    """Check all data against SHACL shapes, and for contradictions.

    The shapes are those that come with the ontology, those of loaded graphs, and those of
    --shapes; the last line counts them. A contradiction is listed by its cause, the smallest set
    of statements that cannot hold together. Exit code 1 if there is a violation or contradiction;
    warnings are only listed. Where there is none, but a shape could not be applied, it is not known
    whether the data conform: "conforms" is null, and the exit code 3.
    """
    with announce_compilation(), Working("checking"), open_to_read(data) as kb:
        report = kb.validate(shapes)
        findings = [*report, *_contradictions(kb)]
    violates = any(finding.severity == "Violation" for finding in findings)
    conforms = False if violates else None if report.left_out else True
    # What speaks most against the data comes first, for it must not be what --limit hides.
    findings.sort(key=lambda finding: finding.severity != "Violation")
    shown = shown_rows(findings, limit, as_json)
    if as_json:
        print_json(
            {
                "conforms": conforms,
                "results": [asdict(finding) for finding in shown],
                "shapes": report.shapes,
                "left_out": report.left_out,
            }
        )
    else:
        for finding in shown:
            where = f" (in {finding.graph})" if finding.graph else ""
            click.echo(f"{finding.severity:10s} {finding}{where}")
        for shape in report.left_out:
            click.echo(f"not applied: {shape}")
        all_well = not findings and not report.left_out
        click.echo(f"{'all well' if all_well else 'checked'}: {_counted(report.shapes)}")
    if not conforms:
        raise SystemExit(1 if violates else 3)


def _counted(shapes: Sequence[str]) -> str:
    """Return how many shapes were applied, and where those of users come from."""
    sources = Counter(name.rpartition(" (")[2][:-1] for name in shapes if name.endswith(")"))
    own = len(shapes) - sources.total()
    parts = [f"{own} shapes of the ontology"]
    parts += [f"{count} of {source}" for source, count in sorted(sources.items())]
    return ", ".join(parts)


def _contradictions(kb: KnowledgeBase) -> list[Violation]:
    """Return each cause of a contradiction as a violation of its first statement."""
    from rtask.kb.commit.validation import Violation

    if kb.plain:
        return []
    return [
        Violation(
            cause["statements"][0][0],
            None,
            None,
            f"contradiction: {cause['message']} ({cause['example']})",
            "OWL 2 RL",
            "Violation",
        )
        for cause in kb.causes()
    ]


@click.command()
@click.argument("what", type=click.Choice([*_PARTS, _READ, *_FILES, "all"]), default="inferred")
@data_option
@json_option
def rebuild(what: str, data: Path, as_json: bool) -> None:
    """Rebuild data that are derived from the graph.

    "union" and "catalogue" of graphs, the "inferred" graph, the "index" of texts and places, the
    "statistics" of grasps, the "recognition" index, the "models" of objects. "blobs" deletes bytes
    that no statement has named for a day. "words" reads the print on stored views that were not
    read yet, with the extra 'words'; it is not part of "all".

    After damage, on a folder that no process has open: "store" rebuilds the quads from a complete
    journal; "journal" starts a new journal in place of a lost one. What is replaced is set aside.
    """
    if what in _FILES:
        from rtask.kb.maintenance.rebuild import rebuild_journal, rebuild_store

        with Working(f"rebuilding the {what}"):
            last = rebuild_store(data) if what == "store" else rebuild_journal(data)
        if as_json:
            print_json({what: last})
        else:
            click.echo(f"{what}: up to commit {last}")
        return
    done = {}
    with open_to_change(data) as kb:
        for part in _PARTS if what == "all" else (what,):
            with Working(f"rebuilding {part}") as working:
                done[part] = _rebuild(kb, part, working)
            if not as_json:
                click.echo(f"{part}: {done[part]}")
    if as_json:
        print_json(done)


def _rebuild(kb: KnowledgeBase, part: str, working: Working) -> str:
    if part == "inferred":
        done = kb.rebuild("inferred")
        return f"+{done.added} -{done.removed}"
    if part == "blobs":
        return f"{kb.collect_blobs()} deleted"
    if part in ("statistics", "recognition", "models", _READ):
        return _rebuild_by_engine(kb, part, working)
    findings = kb.verify(repair=True, parts=(part,))
    return "; ".join(finding.detail for finding in findings) or "nothing to repair"


def _rebuild_by_engine(kb: KnowledgeBase, part: str, working: Working) -> str:
    from rtask.engine import Engine
    from rtask.engine.networks.printed_words import default_reader

    engine = Engine(kb, reader=default_reader() if part == _READ else None)
    try:
        if part == _READ:
            return _counted_words(*engine.read_words(working.tell))
        if part == "recognition":
            return f"{engine.rebuild_index(working.tell)} views"
        if part == "models":
            return f"{engine.rebuild_models(working.tell)} objects"
        done = engine.rebuild_statistics()
        return f"+{done.added} -{done.removed}"
    finally:
        engine.close()


def _counted_words(views: int, words: int, left: int) -> str:
    """Return how many views were read, and which could not be."""
    unread = f"; {left} views have no picture that can be read" if left else ""
    return f"{words} on {views} views{unread}"


@click.command()
@click.argument("records", nargs=-1)
@data_option
@click.option("--release", "action", flag_value="release", help="Put them back into their graphs.")
@click.option("--forget", "action", flag_value="forget", help="Delete them.")
@yes_option
@listing_option
@json_option
def quarantine(
    records: tuple[str, ...],
    data: Path,
    action: str | None,
    yes: bool,
    limit: int | None,
    as_json: bool,
) -> None:
    """List statements that contradict the others; put them back, or delete them.

    A knowledge base that is opened with on_inconsistency="quarantine" sets such statements aside
    instead of refusing the commit; each does so with what stands in the way of a name's owner.
    RECORDS are IRIs from the list; without any, all are meant.
    Putting back fails, and changes nothing, while a statement still contradicts the others.
    """
    records = tuple(name_or_iri(record, data) for record in records)
    if action is not None:
        if action == "forget":
            confirm_final("`rtask history -s` shows the statements, to be asserted anew", yes)
        with open_to_change(data) as kb:
            before = len(kb.quarantined())
            kb.release(records or None, drop=action == "forget")
            count = before - len(kb.quarantined())
        if as_json:
            print_json({action: count})
        else:
            click.echo(f"{count} {'put back' if action == 'release' else 'deleted'}")
            if action == "release":
                announce_final("they stand in their graphs again; `rtask update` withdraws them")
        return
    with open_to_read(data) as kb:
        quarantined = [
            entry for entry in kb.quarantined() if not records or entry.node.value in records
        ]
    shown = shown_rows(quarantined, limit, as_json)
    if as_json:
        print_json(
            [
                {
                    "record": entry.node.value,
                    "triple": [
                        str(entry.quad.subject),
                        str(entry.quad.predicate),
                        str(entry.quad.object),
                    ],
                    "graph": str(entry.quad.graph_name),
                    "reason": entry.reason,
                    "activity": entry.activity.value,
                }
                for entry in shown
            ]
        )
        return
    for entry in shown:
        click.echo(f"{entry.node.value}\n  {entry.quad}\n  {entry.reason}")
    click.echo(f"{len(quarantined)} in quarantine")
