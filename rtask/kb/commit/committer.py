"""Turn a pending change into a stored commit: rights, inference, records, journal, store.

All checks are made before anything is stored, and the result is stored in one atomic step.
"""

from __future__ import annotations

import datetime as dt
import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

from rtask.errors import (
    InconsistentError,
    StorageFullError,
    StoreError,
    TooMuchFollowsError,
    VersionConflictError,
)
from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import UNBOUNDED, Guard, ReasoningLimits, stopping
from rtask.kb.commit.catalogue import Catalogue, GraphFacts
from rtask.kb.commit.checks.requirements import (
    check_blobs,
    check_lengths,
    check_rights,
    check_size,
)
from rtask.kb.commit.checks.testimony import require_own_condition
from rtask.kb.commit.commit import Change, Commit, Request
from rtask.kb.commit.foreign import identity
from rtask.kb.commit.foreign.precedence import NamePrecedence
from rtask.kb.commit.foreign.supports import Support, leaves_of, support_of
from rtask.kb.commit.inference import Inference, Staged, rules_from_now_on
from rtask.kb.commit.quarantine import set_aside
from rtask.kb.commit.schema_right import require_schema
from rtask.kb.commit.trials.derivation import CAN_FORK, MAX_TRIED, LongDerivationError
from rtask.kb.commit.validation import ValidationReport, Validator
from rtask.kb.durability.blobs import BlobStore
from rtask.kb.durability.journal import CommitRecord, Journal
from rtask.kb.rules.rule import Rule
from rtask.kb.rules.rulebook import changed
from rtask.kb.store.apply import apply
from rtask.kb.store.collector import collector_paused
from rtask.kb.store.commit_writes import MAX_LATE, MAX_NOTED_LATE, all_writes, with_union
from rtask.kb.store.embedded import LARGE
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.late_notes import LateNotes
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import Derived, QuadChain
from rtask.kb.store.replacement import ReplacementError, is_large_removal, replace_contents
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import LONG_AGO, GraphName

__all__ = ["Committer"]

_log = logging.getLogger(__name__)
PROOF_BUDGET = 20_000
"""Steps of the search for what an identity rests on."""


@dataclass
class Committer:
    """Stores the changes of one knowledge base; the caller must hold the writer's lock.

    Parameters
    ----------
    inference
        ``None`` without reasoning.
    validator
        ``None`` without validation.
    journal
        Records each change before it is stored.
    interrupted
        Whether Ctrl-C arrived while a commit was being stored. The commit may or may not be in the
        store; it is in the journal, so opening the folder again completes it.
    quarantines
        Move contradictory statements to quarantine instead of refusing the whole commit.
    late
        Where the notes of small commits wait; ``None`` without notes.
    has_schema
        Whether a contributor of a name has the right ``schema``, as far as is known.
    max_change
        Statements that one change of a robot or teacher may add or remove; ``None`` without a
        bound, as where the program that opened the store writes.
    stop
        Set to end the derivation under way, and each later one; large changes of a server's
        callers are refused then.
    """

    store: GraphStore
    graphs: Graphs
    plain: bool
    blobs: BlobStore
    catalogue: Catalogue
    inference: Inference | None
    journal: Journal
    validator: Validator | None = None
    last_seq: int = 0
    last_time: dt.datetime = LONG_AGO
    interrupted: bool = False
    quarantines: bool = False
    late: LateNotes | None = None
    has_schema: Callable[[str], bool] = lambda _: False
    max_change: int | None = None
    stop: threading.Event = field(default_factory=threading.Event)

    def commit(self, change: Overlay, request: Request) -> Change:
        """Store a change with the statements derived from it, or raise and store nothing."""
        makes_many = len(change.added) + len(change.removed) > MAX_LATE
        if makes_many and request.reasoning_limits is not None and self.stop.is_set():
            raise stopping()  # many may wait for the lock, each of which would hold it for long
        with collector_paused() if makes_many else nullcontext():
            if makes_many and self.late is not None:
                self.late.flush()  # now, so that what is looked up of the change stays true
            return self._commit(change, request)

    def _commit(self, change: Overlay, request: Request) -> Change:
        names = self._names(request)
        if self._check(change, request, names) and not request.recount:
            return self._unchanged(request)
        if request.check_blobs and not self.plain:
            check_blobs(change, self.blobs)
        derived, staged, aside = self._settle(change, request, names)
        try:
            # Shapes see what is derived, too: checked after it, and before anything is stored.
            validator = self.validator
            report = ValidationReport() if validator is None else validator.check(change, derived)
            stored = self._store(change, derived, staged, request)
            commit = replace(
                stored.commit,
                warnings=tuple(report),
                shapes=report.shapes,
                quarantined=aside,
                remark=None if names is None else self._remark(names, change, derived),
            )
            return replace(stored, commit=commit)
        except BaseException:
            if staged is not None:
                staged.discard()
            raise

    def rehearse(self, change: Overlay, request: Request) -> tuple[Derived, Staged | None]:
        """Return what would follow from a change, for the caller to discard; store nothing."""
        names = self._names(request)
        if self._check(change, request, names):
            return Derived(), None
        if request.check_blobs and not self.plain:
            check_blobs(change, self.blobs)
        derived, staged, _ = self._settle(change, request, names)
        return derived, staged

    def _names(self, request: Request) -> NamePrecedence | None:
        if request.trusted or self.plain:
            return None
        seq, access = self.last_seq + 1, request.access
        return NamePrecedence(access, self.graphs, self.store, seq, self.has_schema)

    def gives_way(self, supports: Sequence[Support], request: Request) -> bool:
        """Whether statements about the author's names would be set aside; see `Request`."""
        names = self._names(request)
        return names is not None and names.would_give_way(supports)

    def contradicted(
        self, clashes: Sequence[Any], causes: Sequence[Any], request: Request
    ) -> Exception:
        """Return the refusal of a change that contradicts what is stored."""
        assert self.inference is not None
        error, names = self.inference.inconsistent(clashes, causes), self._names(request)
        return error if names is None else names.refused(error, clashes)

    def _remark(self, names: NamePrecedence, change: Overlay, derived: Derived) -> str | None:
        """Return what the author is told of others' statements; ``None`` if nothing."""
        if names.moved:
            return names.remark()
        with self.late.quiet() if self.late is not None else nullcontext():
            keys = self.catalogue.keys()
            remark = identity.remark(change, derived.added, keys, self.store, self.graphs)
        if remark is not None:
            return remark
        return names.notice() if self.catalogue.triple_count(self.graphs.quarantine) else None

    def _settle(
        self, change: Overlay, request: Request, names: NamePrecedence | None
    ) -> tuple[Derived, Staged | None, int]:
        """Derive what follows, after what others have stated of the author's names gave way."""
        if names is None:
            return self._derive(change, request, None)
        self._free_names(change, request, names)
        aside = 0
        while True:
            try:
                derived, staged, more = self._derive(change, request, names)
            except InconsistentError as error:
                raise names.refused(error, error.clashes) from error
            aside += more
            try:
                access = request.access
                require_own_condition(derived.added, access, self.graphs)
                merges = identity.new_merges(change, derived.added, access, self.graphs)
                if not merges:
                    return derived, staged, aside
                if not names.give_way(change, identity.supports_of(merges, staged)):
                    raise identity.merge_refused(
                        merges, change.added, self.store, access, self.graphs
                    )
            except BaseException:
                if staged is not None:
                    staged.discard()
                raise
            if staged is not None:
                staged.discard()

    def _free_names(self, change: Overlay, request: Request, names: NamePrecedence) -> None:
        """Set aside what makes the author's names one with others, before it uses them."""
        if request.supports:
            names.give_way(change, request.supports)
        if self.inference is None or not self.inference.may_hold_equal():
            return
        for triple in names.identities(change):
            proof = self.inference.explain(triple, PROOF_BUDGET)
            if proof.holds:
                names.give_way_to_name(change, leaves_of(proof), triple)

    def _check(self, change: Overlay, request: Request, names: NamePrecedence | None) -> bool:
        """Refuse what may not be written now; return whether the change is empty."""
        if self.interrupted:
            raise StoreError("a write was interrupted; open the knowledge base again")
        # A disk that was full leaves the store refusing everything, even when there is room again.
        if self.store.is_stuck:
            self.store.reopen()
        is_empty = change.is_empty()  # a store elsewhere may learn here of other commits
        self._check_version(request)
        if not request.trusted:
            self.check_size(len(change.added), len(change.removed), request.access)
            check_rights(change, request, self.graphs, self.catalogue.triple_count, self.plain)
        if names is not None:
            names.give_way_to_ids(change)
            require_schema(change, request.access, self.graphs, self.catalogue.declared)
        if not request.trusted:
            check_lengths(change)
        return is_empty

    def check_size(self, added: int, removed: int, access: Access) -> None:
        """Refuse a change that is too large for its author, which needs no lock.

        Raises
        ------
        TooLargeError
            Naming the bound, and how to split the change.
        """
        check_size(added, removed, access, None if self.plain else self.max_change)

    def _check_version(self, request: Request) -> None:
        if request.if_version is not None and request.if_version != self.last_seq:
            raise VersionConflictError(
                f"expected version {request.if_version}, found {self.last_seq}; "
                "read again and retry",
                expected=request.if_version,
                found=self.last_seq,
            )

    def _derive(
        self, change: Overlay, request: Request, names: NamePrecedence | None
    ) -> tuple[Derived, Staged | None, int]:
        rules = None if self.plain else changed(change, self.graphs)
        if self.inference is None:
            return Derived(), None, 0
        size = len(change.added) + len(change.removed)
        is_tried = self._is_tried(request, size)
        limits = request.reasoning_limits or UNBOUNDED
        guard = Guard(limits, self.stop)
        budget = limits.first_look(size, guard) if is_tried else limits.budget(size, guard)
        # Notes say nothing about the world, so those that wait do not matter here.
        with self.late.quiet() if self.late is not None else nullcontext():
            if request.trial is not None:
                change.holders = request.trial.holders
                adopted = self.inference.adopt(change, rules, request.trial)
                if adopted is not None:
                    return *adopted, 0
            if is_tried:
                return self._look_at(change, request, rules, budget, limits, names)
            if self.quarantines and not request.strict:
                return self._set_aside(change, rules, budget, names)

            def gives_way(clashes: Sequence[Any]) -> bool:
                return names is not None and names.give_way(change, map(support_of, clashes))

            return *self.inference.stage(change, rules, request.cause_ms, budget, gives_way), 0

    def _set_aside(
        self,
        change: Overlay,
        rules: Sequence[Rule] | None,
        budget: Any,
        names: NamePrecedence | None,
    ) -> tuple[Derived, Staged, int]:
        """Derive what follows, and move what contradicts the rest to quarantine."""
        assert self.inference is not None
        seq, inference, graphs = self.last_seq + 1, self.inference, self.graphs
        # Names give way first: what others said of them must not send their author's to quarantine.
        while names is not None:
            derived, staged, clashes = inference.try_stage(change, rules, budget)
            if staged is not None:
                return derived, staged, 0
            if not names.give_way(change, map(support_of, clashes)):
                break
        return set_aside(change, inference, graphs, seq, rules, budget)

    @staticmethod
    def _is_tried(request: Request, size: int) -> bool:
        """Whether a derivation that a first look does not end is tried aside."""
        limited = request.reasoning_limits is not None
        return limited and CAN_FORK and request.is_repeatable and 0 < size <= MAX_TRIED

    def _look_at(
        self,
        change: Overlay,
        request: Request,
        rules: Sequence[Rule] | None,
        budget: Any,
        limits: ReasoningLimits,
        names: NamePrecedence | None,
    ) -> tuple[Derived, Staged | None, int]:
        """Derive what follows from a change, or raise :class:`LongDerivationError`."""
        from reasoner import NeedsRebuildError

        assert self.inference is not None
        size = len(change.added) + len(change.removed)
        sets_aside = self.quarantines and not request.strict
        again = True
        while again:
            gained, lost = self.inference.gained_and_lost(change)
            try:
                if sets_aside:
                    return self._set_aside(change, rules, budget, names)
                derived, staged, clashes = self.inference.try_derive(gained, lost, rules, budget)
            # It goes on in another process, so that writers do not wait for it behind the lock.
            except (TooMuchFollowsError, NeedsRebuildError):
                break
            if not clashes:
                return derived, staged, 0
            again = names is not None and names.give_way(change, map(support_of, clashes))
        raise LongDerivationError(
            gained,
            lost,
            rules_from_now_on(rules),
            size,
            limits,
            None if sets_aside else request.cause_ms,
            change.holders,
            () if names is None else names.supports,
        )

    def _store(
        self, change: Overlay, derived: Derived, staged: Staged | None, request: Request
    ) -> Change:
        late = self.late
        if late is None:
            return self._store_now(change, derived, staged, request)
        size = len(change.added) + len(change.removed) + len(derived.added)
        small = size <= MAX_NOTED_LATE
        common = not (change.dropped or request.sources or request.recount)
        with late.storing(small and common) as is_late, late.quiet():
            return self._store_now(change, derived, staged, request, late if is_late else None)

    def _store_now(
        self,
        change: Overlay,
        derived: Derived,
        staged: Staged | None,
        request: Request,
        late: LateNotes | None = None,
    ) -> Change:
        record = self._next_record(request)
        notes = Overlay(self.store)
        if not self.plain:
            current = self._closure_state(change, staged, request)
            facts = GraphFacts(
                request.kinds, request.sources, self._sizes(request, change, derived), current
            )
            notes = self.catalogue.record(change, derived, record, facts)
        whole = all_writes(change, derived, notes)
        # The journal first: from here on the next opening completes the commit, however this ends.
        self.journal.append(record, whole)
        self.interrupted = True
        try:
            if is_large_removal(self.store, whole):
                # Killed on the way, only the journal knows how to go on.
                self.journal.sync(record.seq)
                replace_contents(self.store, whole)
            else:
                now = whole if late is None else all_writes(change, derived, Overlay(self.store))
                self._write(now, change, record.seq)
        except ReplacementError:
            raise  # the journal keeps the commit, and opening the folder again completes it
        except Exception as error:
            self.journal.withdraw()
            self.interrupted = False
            if "No space left" in str(error):
                self.store.is_stuck = True
                raise StorageFullError("no room in the store; nothing was stored") from error
            raise
        # Not before: notes of a commit that failed would be stored with the next one.
        if late is not None:
            late.add(notes)
        # After the store, which cannot be made from the closure; the closure can from the store.
        if staged is not None:
            staged.apply()
        self._advance(record, notes, change)
        self.interrupted = False
        return self._describe(change, derived, record, request)

    def _write(self, writes: Writes, change: Overlay, seq: int) -> None:
        """Change the store, and the union in it."""
        if not (self.plain or self.store.is_view):
            fresh = (self.graphs.provenance,)
            writes = with_union(self.store, writes, fresh, change.holders)
        if len(writes.added) > LARGE:
            self.journal.sync(seq)
        apply(self.store, writes)

    def _closure_state(
        self, change: Overlay, staged: Staged | None, request: Request
    ) -> bool | None:
        """Whether the inferred graph is current after this commit; ``None`` if irrelevant."""
        if staged is not None or (request.trusted and self.inference is not None):
            return True
        touched = change.touched_graphs() | request.recount
        concerned = self.graphs.rules in touched or any(map(self.graphs.is_input, touched))
        return False if concerned else None

    def _sizes(self, request: Request, change: Overlay, derived: Derived) -> dict[GraphName, int]:
        added = QuadChain(change.added, derived.added)
        removed = QuadChain(change.removed, derived.removed)
        return {
            graph: self.store.count(graph)
            + sum(quad.graph_name == graph for quad in added)
            - sum(quad.graph_name == graph for quad in removed)
            for graph in request.recount
        }

    def _next_record(self, request: Request) -> CommitRecord:
        # As the clock has it, even if it was set back: commits are ordered by their numbers.
        ended = dt.datetime.now(dt.UTC)
        started = min(request.started, ended)
        return CommitRecord(
            self.last_seq + 1,
            started,
            ended,
            request.access.agent,
            request.access.role,
            request.note,
            is_partial=bool(request.recount),
        )

    def _advance(self, record: CommitRecord, notes: Overlay, change: Overlay) -> None:
        self.last_seq, self.last_time = record.seq, record.ended
        if not self.plain:
            self.catalogue.apply(notes)
            for graph in change.dropped:
                self.catalogue.forget(graph)

    def _describe(
        self, change: Overlay, derived: Derived, record: CommitRecord, request: Request
    ) -> Change:
        commit = Commit(
            seq=record.seq,
            added=len(change.added),
            removed=len(change.removed),
            derived=len(derived.added),
            time=record.ended,
            activity=None if self.plain else self.catalogue.activity(record.seq),
            withdrawn=len(derived.removed),
        )
        _log.debug("commit %d: +%d -%d", commit.seq, commit.added, commit.removed)
        return Change(
            commit,
            request.access.agent,
            request.note,
            tuple(change.added),
            tuple(change.removed),
            derived.added,
            derived.removed,
        )

    def _unchanged(self, request: Request) -> Change:
        commit = Commit(self.last_seq, 0, 0, 0, dt.datetime.now(dt.UTC), None)
        return Change(commit, request.access.agent, request.note, (), (), (), ())
