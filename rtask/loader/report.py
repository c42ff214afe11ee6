"""Report of a load, file by file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

__all__ = ["Counts", "FileReport", "LoadReport"]


class Counts(NamedTuple):
    """Numbers of statements that were read, added, removed and derived."""

    read: int
    added: int
    removed: int
    derived: int


@dataclass(frozen=True)
class FileReport:
    """Result of loading one document.

    Parameters
    ----------
    graph
        IRI of the target graph; empty for documents that name their graphs themselves.
    read
        Number of statements in the document, or of rules.
    added, removed, derived
        Numbers of statements added to, removed from and derived in the knowledge base.
    patches
        Names of the patches that were applied to faults of the document; see
        :mod:`rtask.loader.patches`.
    """

    name: str
    format: str
    graph: str
    read: int
    added: int
    removed: int
    derived: int
    seconds: float
    patches: tuple[str, ...] = ()


@dataclass
class LoadReport:
    """Result of a load.

    Parameters
    ----------
    undeclared
        Properties and classes that neither the documents nor the knowledge base describe;
        reported by a dry run only.
    warnings
        Violations reported by validation, JSON-LD keys that no context defines, and things that
        are one from now on, or share a key with somebody else's.
    """

    files: list[FileReport] = field(default_factory=list)
    missing_imports: list[str] = field(default_factory=list)
    undeclared: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    dry_run: bool = False

    @property
    def added(self) -> int:
        """Statements added by all files."""
        return sum(file.added for file in self.files)

    @property
    def derived(self) -> int:
        """Statements derived from all files."""
        return sum(file.derived for file in self.files)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON-able values."""
        return asdict(self)
