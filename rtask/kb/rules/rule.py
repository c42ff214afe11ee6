"""Rules of the user as objects, and how they are read from files and text."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from rtask.errors import ParseError, UsageError
from rtask.rdf.terms import NamedNode

__all__ = ["EXTENSIONS", "Rule", "Source", "is_rule_file", "read_rules"]

EXTENSIONS = (".rq", ".rules")
"""Extensions of files with rules."""

_HEADING = re.compile(r"#[ \t]*rule:[ \t]*(?P<label>.*?)[ \t]*\r?")
_COMMENT = re.compile(r"#[ \t]?(.*)")


@dataclass(frozen=True)
class Rule:
    """A rule of the user: what follows from what, as a SPARQL CONSTRUCT query.

    Parameters
    ----------
    label
        Short name, by which proofs and the command line know the rule.
    text
        CONSTRUCT query; docs/reasoning.md says what it may contain.
    comment
        What the rule is for.
    iri, author, time
        Of a rule in a knowledge base: its IRI, who added it, and when.

    Examples
    --------
    >>> Rule("on is above", "CONSTRUCT { ?a <urn:above> ?b } WHERE { ?a <urn:on> ?b }").label
    'on is above'
    """

    label: str
    text: str
    comment: str = ""
    iri: NamedNode | None = None
    author: NamedNode | None = None
    time: dt.datetime | None = None

    def to_dict(self) -> dict[str, str | None]:
        """Return the rule as JSON-able values."""
        return {
            "label": self.label,
            "text": self.text,
            "comment": self.comment,
            "iri": self.iri.value if self.iri else None,
            "author": self.author.value if self.author else None,
            "time": self.time.isoformat() if self.time else None,
        }

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> Rule:
        """Return the rule that :meth:`to_dict` gave.

        >>> rule = Rule("on is above", "CONSTRUCT {}", iri=NamedNode("urn:rule:1"))
        >>> Rule.from_dict(rule.to_dict()) == rule
        True
        """
        iri, author, time = value["iri"], value["author"], value["time"]
        return cls(
            value["label"],
            value["text"],
            value["comment"],
            NamedNode(iri) if iri else None,
            NamedNode(author) if author else None,
            dt.datetime.fromisoformat(time) if time else None,
        )


Source: TypeAlias = Rule | Path | str
"""A rule, a file or folder of rules, or the text of rules."""


def is_rule_file(path: Path | str) -> bool:
    """Whether a file holds rules, going by its extension.

    >>> is_rule_file("heavy.rq"), is_rule_file("mugs.ttl")
    (True, False)
    """
    return Path(path).suffix.lower() in EXTENSIONS


def read_rules(sources: Source | Iterable[Source]) -> list[Rule]:
    """Read rules from objects, files, folders and text.

    A file with several rules has a comment line ``# rule: LABEL`` before each; PREFIX lines before
    the first of them hold for all. A file without such a line is one rule, labelled with the file's
    name.

    Raises
    ------
    UsageError
        A file does not exist, two rules have one label, or a text has no label.
    ParseError
        A file is not UTF-8 text.
    """
    given = [sources] if isinstance(sources, Rule | Path | str) else list(sources)
    rules: dict[str, Rule] = {}
    for source in given:
        for rule in [source] if isinstance(source, Rule) else _read(source):
            if rule.label in rules:
                raise UsageError(f"two rules are labelled {rule.label!r}; rename one of them")
            rules[rule.label] = rule
    return list(rules.values())


def _read(source: Path | str) -> Iterator[Rule]:
    if isinstance(source, str) and "{" in source:
        yield from parse_rules(source, "")
        return
    path = Path(source)
    if path.is_dir():
        paths = sorted(file for file in path.iterdir() if is_rule_file(file))
        if not paths:
            raise UsageError(f"{path} contains no file with rules ({', '.join(EXTENSIONS)})")
    else:
        paths = [path]
    for file in paths:
        try:
            text = file.read_text("utf-8")
        except UnicodeDecodeError as error:
            raise ParseError(f"{file}: not UTF-8 text") from error
        except OSError as error:
            raise UsageError(f"{file}: {error.strerror}") from error
        yield from parse_rules(text, file.stem)


def parse_rules(text: str, name: str) -> Iterator[Rule]:
    """Yield the rules of a text.

    The lines of other rules are blanked and not left out, so that errors give the line of the file.

    Parameters
    ----------
    name
        Label of a rule without heading.

    Raises
    ------
    UsageError
        A rule has no label.
    """
    lines = text.splitlines()
    headings = [
        (number, heading["label"])
        for number, line in enumerate(lines)
        if (heading := _HEADING.fullmatch(line.strip()))
    ]
    if not headings:
        headings, first = [(0, name)], 0
    else:
        first = headings[0][0]
    ends = [number for number, _ in headings[1:]] + [len(lines)]
    for (start, label), end in zip(headings, ends, strict=True):
        if not label:
            raise UsageError(
                "a rule has no label; write the line `# rule: LABEL` before it, "
                "or pass rtask.Rule(label, text)"
            )
        blank = [""] * (start - first)
        own = lines[:first] + blank + lines[start:end]
        yield Rule(label, "\n".join(own), _comment(lines[start:end]))


def _comment(lines: Iterable[str]) -> str:
    """Return the comment lines at the head of a rule, its heading left out, as one text."""
    comment = []
    for line in lines:
        matched = _COMMENT.fullmatch(line.strip())
        if matched is None:
            if line.strip():
                break
        elif not _HEADING.fullmatch(line.strip()):
            comment.append(matched[1].strip())
    return " ".join(filter(None, comment))
