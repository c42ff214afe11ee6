"""Make things of the products in a graph that is older than things.

Such a graph says where robots saw a product (``rt:PoseEstimate``), and what each attempt did to it.
Both are carried out again, in the order of time, by the rules by which robots' reports make things
today; what follows goes to the graph of the robot that had reported it. A product is one commit,
so that a run that was killed goes on with the next one, and readers see each product before or
after.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.engine.records.exemplars import Left, leave_exemplar
from rtask.engine.records.places import may_have_touched
from rtask.errors import ConflictError
from rtask.kb.reverting import BUNDLED
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, Quad, iri, object_term, python_value
from rtask.world import WorldEdit, world_of
from rtask.world.edit import Seen
from rtask.world.estimates import estimates_of
from rtask.world.placement import Placement, seconds

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Migration", "migrate", "undo_migration"]

_NOTE = "things of the product "
_UNDO = "undo things, commit "
_ATTEMPTS = """
SELECT DISTINCT ?graph ?attempt ?robot ?hand ?ended ?held ?placed ?place ?name ?reason WHERE {
  ?task rt:handles $product .
  GRAPH ?graph { ?task rt:through ?attempt }
  ?attempt rt:performedBy ?robot ; rt:activates ?hand ; prov:endedAtTime ?ended ;
    rt:hasOutcome ?outcome .
  ?outcome rt:success ?held
  OPTIONAL { ?outcome rt:placed ?placed }
  OPTIONAL { ?outcome rt:hasReason/rt:code ?reason }
  OPTIONAL { ?placing rt:carriedOutBy ?attempt ; rt:targetSurface ?place . ?place rt:name ?name }
} ORDER BY ?ended ?attempt"""


@dataclass(frozen=True)
class Migration:
    """What a migration made.

    Parameters
    ----------
    products, exemplars, placements
        Numbers of products that got things, of the things, and of their placements.
    skipped
        IRIs of products that had things already, so that their older reports stay as they are.
    commits
        First and last commit; None if there was nothing to do.
    """

    products: int = 0
    exemplars: int = 0
    placements: int = 0
    skipped: tuple[str, ...] = ()
    commits: tuple[int, int] | None = None


@dataclass(frozen=True)
class _Report:
    """A sighting, or an attempt with what it left, in the graph of its robot."""

    time_s: float
    order: int
    node: NamedNode
    graph: NamedNode
    robot: NamedNode
    seen: Placement | None = None
    left: Left | None = None
    reason: str = ""


def migrate(kb: GraphCore, on_product: Callable[[str], None] | None = None) -> Migration:
    """Make things of all products that have none and that robots saw or handled.

    Parameters
    ----------
    on_product
        Called with the IRI of each product that is done.
    """
    products = exemplars = placements = 0
    skipped, commits = [], []
    for product in _products(kb):
        if world_of(kb).exemplars_of(product):
            if any(_is_pending(kb, report) for report in _reports(kb, product)):
                skipped.append(product)
            continue
        added, removed = _changes(kb, product)
        if not added:
            continue
        with kb.transaction(note=f"{_NOTE}{product}") as tx:
            tx.remove_quads(removed)
            tx.add_quads(added)
        commits.append(tx.commit.seq)
        products += 1
        exemplars += sum(quad.predicate == RT.exemplarOf for quad in added)
        placements += sum(quad.predicate == RT.placementOf for quad in added)
        if on_product is not None:
            on_product(product)
    span = (commits[0], commits[-1]) if commits else None
    return Migration(products, exemplars, placements, tuple(skipped), span)


def undo_migration(kb: GraphCore) -> list[int]:
    """Undo a migration, commit by commit; return the commits that are undone.

    Raises
    ------
    ConflictError
        Something was written since, or there was no migration.
    """
    undone: set[int] = set()
    pending: list[int] = []
    for seq in range(kb.seq, 0, -1):
        note = next((c.note or "" for c in kb.feed.changes(seq - 1, seq)), "")
        if note.startswith(_UNDO):
            undone.add(int(note.removeprefix(_UNDO)))
        elif note.startswith(_NOTE):
            pending += [] if seq in undone else [seq]
        elif note != BUNDLED:
            break
    if not (pending or undone):
        raise ConflictError(
            f"the last commit, {kb.seq}, is not of a migration; it can be undone as a whole until "
            "something else is written, and then commit by commit: `rtask history`, `rtask undo`"
        )
    for seq in pending:
        kb.revert(seq, note=f"{_UNDO}{seq}")
    return pending


def _products(kb: GraphCore) -> list[str]:
    rows = kb.select(f"{PREFIXES}SELECT DISTINCT ?p {{ ?p rt:objectId ?id }} ORDER BY ?p")
    return [str(row.value("p")) for row in rows]


def _is_pending(kb: GraphCore, report: _Report) -> bool:
    predicate = RT.handlesExemplar if report.seen is None else RT.poseOfExemplar
    return not kb.match(report.node, predicate)


def _changes(kb: GraphCore, product: str) -> tuple[list[Quad], list[Quad]]:
    """Return the statements to add and to remove for a product, each in the graph of its robot."""
    reports = sorted(_reports(kb, product), key=lambda r: (r.time_s, r.order, r.node.value))
    hands: dict[NamedNode, set[str]] = {}
    for report in reports:
        if report.left is not None:
            hands.setdefault(report.robot, set()).add(report.left.hand.value)
    edit = WorldEdit(world_of(kb), kb.graphs.shared)
    extent = min((_number(kb, product, name) for name in (RT.extentX, RT.extentY)), default=0.0)
    stated = [q for q in kb.match(iri(product), RT.locatedOn) if q.graph_name != kb.graphs.inferred]
    held = {quad.object for quad in stated}
    added: list[Quad] = []
    for report in reports:
        edit.graph = report.graph
        if report.left is not None and report.left.hand not in held:
            # Whether it was held to the end is stated only of what is in a hand now.
            report = replace(report, left=replace(report.left, placed=bool(report.left.placed)))
        exemplar = _carry_out(edit, product, report, hands.get(report.robot, set()), extent)
        statements, _ = edit.drain()
        if exemplar:
            link = RT.handlesExemplar if report.seen is None else RT.poseOfExemplar
            statements.append((report.node, link, iri(exemplar)))
        added += [Quad(s, p, object_term(o), report.graph) for s, p, o in statements]
    places = {q.object for q in added if q.predicate in (RT.placedOn, RT.placedIn, RT.heldBy)}
    return added, [quad for quad in stated if quad.object in places]


def _carry_out(
    edit: WorldEdit, product: str, report: _Report, hands: set[str], extent_m: float
) -> str:
    """State what follows from a report; return the thing that it is about, "" if nobody knows."""
    seen, left = report.seen, report.left
    if seen is not None and seen.frame_from_subject is not None:
        return edit.see(
            Seen(
                product, seen.frame, seen.frame_from_subject, report.time_s,
                confidence=seen.confidence, min_extent_m=extent_m, robot=report.robot.value,
                hands=hands, agent=seen.agent, source=seen.source,
            )
        )  # fmt: skip
    assert left is not None
    exemplar = edit.exemplar_of(product, report.robot.value, hands)
    if not exemplar and left.held:
        exemplar = edit.make_exemplar(product)
    if exemplar and may_have_touched(report.reason):
        leave_exemplar(edit, exemplar, left, report.time_s, report.robot, report.node)
    return exemplar


def _reports(kb: GraphCore, product: str) -> Iterator[_Report]:
    """Yield what robots reported about a product."""
    for placement in estimates_of(kb, product):
        node = iri(placement.iri)
        owned_by, _, _ = placement.frame.rpartition("/frame/")
        graphs = [q.graph_name for q in kb.match(node, RT.poseOf, iri(product))]
        graph = next((g for g in graphs if g != kb.graphs.inferred), None)
        if owned_by and isinstance(graph, NamedNode):
            yield _Report(placement.begin, 0, node, graph, iri(owned_by), seen=placement)
    for row in kb.select(PREFIXES + _ATTEMPTS.replace("$product", str(iri(product)))):
        owner, attempt, robot, hand, place = (
            row[name] for name in ("graph", "attempt", "robot", "hand", "place")
        )
        if not isinstance(owner, NamedNode) or owner == kb.graphs.inferred:
            continue
        if not (isinstance(attempt, NamedNode) and isinstance(robot, NamedNode)):
            continue
        if not isinstance(hand, NamedNode):
            continue
        placed = None if row["placed"] is None else bool(row.value("placed"))
        put = place if isinstance(place, NamedNode) else None
        left = Left(hand, bool(row.value("held")), placed, put, str(row.value("name") or ""))
        yield _Report(
            seconds(row.value("ended")), 1, attempt, owner, robot, left=left,
            reason=str(row.value("reason") or ""),
        )  # fmt: skip


def _number(kb: GraphCore, product: str, name: NamedNode) -> float:
    numbers = [float(str(python_value(quad.object))) for quad in kb.match(iri(product), name)]
    return min(numbers, default=0.0)
