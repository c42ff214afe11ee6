"""Settings of a knowledge base (``kb.json``), fixed when it is created."""

from __future__ import annotations

import datetime as dt
import json
import os
import secrets
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path

import ontology
from rtask.errors import NoStoreError, StoreFormatError, UsageError
from rtask.kb.durability.blobs import sync_folder

__all__ = ["Settings"]

FORMAT = 1
UNIONS = ("merged", "view")
_FILE = "kb.json"


@dataclass(frozen=True)
class Settings:
    """Identity and kind of a knowledge base.

    Parameters
    ----------
    store_id
        Random; part of the base unless a base was given.
    epoch
        Identifier of the commit numbering; changes when the order of commits may have been lost,
        e.g. by a restore from a backup.
    base
        IRI that starts every instance and graph.
    plain
        Whether this is a bare SPARQL 1.1 dataset without union, inference and provenance.
    created
        UTC, ISO 8601.
    union
        ``merged`` keeps each distinct triple once in the default graph; ``view`` lets each query
        compute it.
    parent
        Store and commit of the backup that this was restored from.
    store
        Address of the SPARQL server that holds the statements; ``None`` if the folder does.
    """

    store_id: str
    epoch: str
    base: str
    plain: bool
    created: str
    format: int = FORMAT
    union: str = "merged"
    parent: str | None = None
    store: str | None = None

    @classmethod
    def new(
        cls, base: str | None = None, plain: bool = False, union: str | None = None
    ) -> Settings:
        """Return the settings of a new knowledge base."""
        store_id = secrets.token_hex(6)
        if base is None:
            base = f"{ontology.BASE}{store_id}/"
        if not base.endswith(("/", "#", ":")):
            raise UsageError(f"a base must end in '/', '#' or ':', got {base!r}")
        union = union or "merged"
        if union not in UNIONS:
            raise UsageError(f"unknown union {union!r}; one of {', '.join(UNIONS)}")
        now = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        return cls(store_id, secrets.token_hex(4), base, plain, now, union=union)

    @property
    def is_view(self) -> bool:
        """Whether queries compute the union of the graphs."""
        return self.union == "view" and not self.plain

    @property
    def is_merged(self) -> bool:
        """Whether the union of the graphs is stored."""
        return self.union == "merged" and not self.plain

    @classmethod
    def load(cls, folder: Path) -> Settings:
        """Read the settings of a folder.

        Raises
        ------
        StoreFormatError
            If the folder is not a knowledge base (NoStoreError), or has another format.
        """
        try:
            record = json.loads((folder / _FILE).read_text("utf-8"))
            if not isinstance(record, dict) or not isinstance(record.get("format"), int):
                raise ValueError('it is no JSON object with a number "format"')
            stored = int(record["format"])
        except FileNotFoundError:
            raise NoStoreError(
                f"{folder} is not a knowledge base (no {_FILE}); reading takes a folder that RTASK "
                "made, writing an empty or new one as well",
                absent=True,
            ) from None
        except (ValueError, KeyError, TypeError) as error:
            raise StoreFormatError(f"{folder / _FILE} is damaged: {error}") from error
        if stored != FORMAT:
            age = "newer" if stored > FORMAT else "older"
            cure = "update RTASK" if stored > FORMAT else "export it with the version that made it"
            raise StoreFormatError(
                f"{folder} has the {age} format {stored}, this version reads {FORMAT}; {cure}",
                format=stored,
            )
        settings = {field.name: field for field in fields(cls)}
        required = {name for name, field in settings.items() if field.default is MISSING}
        if missing := required - record.keys():
            raise StoreFormatError(
                f"{folder / _FILE} is damaged: it lacks {', '.join(sorted(missing))}; restore it "
                "from a backup"
            )
        return cls(**{name: record[name] for name in settings if name in record})

    def save(self, folder: Path) -> None:
        """Write the settings durably."""
        write_durably(folder / _FILE, json.dumps(asdict(self), indent=2) + "\n")

    def require(
        self, folder: Path, base: str | None, plain: bool, union: str | None = None
    ) -> None:
        """Raise unless these settings agree with those that the caller asked for."""
        if base is not None and base != self.base:
            raise StoreFormatError(f"{folder} has the base {self.base}, not {base}")
        if union is not None and union != self.union:
            raise StoreFormatError(f"{folder} was made with union={self.union!r}, not {union!r}")
        if plain and not self.plain:
            raise StoreFormatError(f"{folder} was not made with plain=True and cannot become so")


def write_durably(path: Path, text: str) -> None:
    """Replace a small file so that a power cut leaves either the old or the new content."""
    temporary = path.with_suffix(".tmp")
    with temporary.open("w", encoding="utf-8") as out:
        out.write(text)
        out.flush()
        os.fsync(out.fileno())
    temporary.replace(path)
    sync_folder(path.parent)
