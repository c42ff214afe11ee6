"""Methods for changes that wait for a decision: try, propose and adopt."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pyoxigraph import Quad

from rtask.errors import ConflictError, ForbiddenError
from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import OF_OPERATORS, OF_ROBOTS
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.transaction import Transaction
from rtask.kb.proposals.proposal import Proposal
from rtask.kb.proposals.trial import Trial, try_change
from rtask.kb.writing import Writing
from rtask.rdf.terms import stored_quad

__all__ = ["Proposing"]

# As much may follow as from the update of an operator, who would adopt the change. But anybody may
# ask for a trial, so time and memory are those of a robot's commit.
_OF_TRIALS = replace(OF_OPERATORS, seconds=OF_ROBOTS.seconds, memory_bytes=OF_ROBOTS.memory_bytes)


class Proposing(Writing):
    """Proposals of this graph; see :mod:`rtask.kb.proposals.register`."""

    def propose(
        self,
        added: Iterable[Quad],
        removed: Iterable[Quad] = (),
        *,
        author: str | None,
        reason: str = "",
        rests_on: int | None = None,
    ) -> Proposal:
        """Keep a change without effect until somebody with the right to it decides.

        Parameters
        ----------
        added, removed
            Statements to assert and to withdraw, each with its graph.
        author
            Name of the robot or person.
        reason
            What the change is for.
        rests_on
            Number of the commit that the author has seen; the last one if not given.

        Raises
        ------
        UsageError, TooLargeError, QueueFullError
            As :meth:`rtask.kb.proposals.register.Proposals.add`.
        """
        seq = self.seq if rests_on is None else rests_on
        return self.proposals.add(added, removed, author or "", seq, reason)

    def try_change(
        self,
        added: Iterable[Quad],
        removed: Iterable[Quad] = (),
        *,
        agent: str | None = None,
        access: Access | None = None,
    ) -> Trial:
        """Return what a change would do, with reasoning and shapes, and store nothing.

        Others go on writing while a long derivation is tried in a copy of this process.

        Parameters
        ----------
        added, removed
            Statements to assert and to withdraw, each with its graph.
        agent, access
            With whose rights; by default those of the program that opened the knowledge base.

        Raises
        ------
        RtaskError
            As :meth:`update`, where the change would be refused.
        """
        lost, gained = [*map(stored_quad, removed)], [*map(stored_quad, added)]

        def rehearse(request: Request, _: object) -> Trial:
            overlay = self._writer.begin()
            try:
                for quad in lost:
                    overlay.remove(quad)
                overlay.add_all(gained)
                return try_change(self._writer.committer, overlay, request)
            finally:
                self._writer.cancel()

        # On a branch the trunk would stand still as long: its closure is what a branch reasons on.
        request = Request(self.access(agent, access), strict=True, reasoning=_OF_TRIALS)
        return self._writer.commit_repeatably(rehearse, request)

    def adopt(self, number: int, *, access: Access | None = None) -> Commit:
        """Carry a proposal out as one commit, checked against what holds now.

        Parameters
        ----------
        access
            Who adopts it; must be allowed to write its graphs and to state axioms.

        Raises
        ------
        UnknownTermError
            There is no proposal with this number.
        ConflictError
            It was decided before, or a statement that it withdraws has gone since.
        ForbiddenError
            The caller may not adopt it.
        RtaskError
            As :meth:`update`; the proposal stays open.
        """
        rights = self.access(access=access)
        if not rights.may_decide:
            raise ForbiddenError(
                "adopting a proposal needs the right schema, which an admin has", right="schema"
            )
        proposals = self.proposals
        with proposals.deciding:
            proposal = proposals.require_open(number)
            tx = self._carry_out(proposal, rights)
            proposals.adopted(number, rights.agent or rights.role, tx.commit.seq)
        return tx.commit

    def _carry_out(self, proposal: Proposal, rights: Access) -> Transaction:
        """Commit what a proposal adds and removes, if all that it removes is there."""
        added, removed = proposal.quads()
        number, author = proposal.number, proposal.author or "a caller without a name"
        note = f"proposal {number} of {author}"
        with self.transaction(note=note, access=rights) as tx:
            for quad in removed:
                if not tx.holds(quad):
                    raise ConflictError(
                        f"proposal {number} withdraws a statement that is there no more: {quad}"
                    )
            tx.remove_quads(removed)
            tx.add_quads(added)
        return tx
