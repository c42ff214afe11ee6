"""Experience of learners from the graph, and their states saved in it.

The engine's own learner has no state: every decision is made from the outcomes in the graph
(:mod:`rtask.engine.memory.experience`), so it continues wherever the graph is opened. The learners
of Gatto 2016, 3.3.4 (:mod:`grasp.learning.agents`) learn step by step. They either relearn from
the outcomes of all robots, with states computed from the stored descriptors, or load a state that
was saved as a blob; a state of another version is not loaded, and a note says so.
"""

from __future__ import annotations

import datetime as dt
import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasp.learning.env import quadrant
from grasp.learning.state import GrowingComponents, pooled
from grasp.learning.transition import Transition
from grasp.spatial.frames import closing_yaw, matrix_from_pose
from rtask.engine.names import slug
from rtask.engine.policy import JUDGED
from rtask.engine.stored import stored_views
from rtask.engine.triples import Triples, stamp
from rtask.errors import MissingBlobError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import iri, literal
from rtask.scratch import ScratchFolder
from rtask.sparql.results import Row

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = [
    "Resumed", "Saved", "Training", "adopt_policy", "experience", "keep_learner", "resume_learner",
]  # fmt: skip

log = logging.getLogger(__name__)


class Saved(Protocol):
    """A learner whose state can be saved and loaded."""

    def save(self, path: Path) -> None:
        """Save the state."""

    def load(self, path: Path) -> None:
        """Load a saved state; raises ValueError if the file does not fit."""


@dataclass(frozen=True)
class Resumed:
    """Result of loading a learner's state.

    Parameters
    ----------
    note
        Why others were not loaded.
    snapshot
        IRI of what was loaded.
    """

    done: bool
    note: str = ""
    snapshot: str = ""


def experience(context: Context) -> list[Transition]:
    """Return the attempts of all robots as transitions of the thesis's problem, oldest first.

    The state is how the object looks, in five components of all views that this release can read;
    the action is the quadrant of the closing direction, the reward whether it held. Views of
    another extractor's version are left out, and attempts on objects that no other view shows.

    Returns
    -------
    One step for each judged attempt; people's verdicts count, disputed ones do not.
    """
    states = _states(context)
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?attempt ?ended ?object ?theta ?held ?qx ?qy ?qz ?qw WHERE {{
  ?object rt:objectId ?id ; rt:hasGrasp ?grasp . ?grasp rt:graspPose ?pose . {JUDGED}
  OPTIONAL {{ ?pose rt:theta ?theta }}
  OPTIONAL {{ ?pose rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw }}
}} ORDER BY ?ended ?attempt ?object""")
    steps = []
    for row in rows:
        at: dict[str, Any] = row.to_dict()
        state = states.get(str(at["object"]))
        theta = _closing_yaw(at)
        if state is not None and theta is not None:
            reward = 1.0 if at["held"] else -1.0
            steps.append(Transition(state, quadrant(theta), reward, state, True))
    return steps


def _closing_yaw(at: dict[str, Any]) -> float | None:
    """Return the closing direction about z of a grasp, rad; None if its pose is incomplete."""
    if at["theta"] is not None:
        return float(at["theta"])
    if at["qw"] is None:
        return None
    quaternion = np.array([float(at["q" + axis]) for axis in "xyzw"])
    return closing_yaw(matrix_from_pose(np.zeros(3), quaternion))


def _states(context: Context) -> dict[str, NDArray[np.float64]]:
    """Return five principal components of each object's appearance."""
    # All views before any state: the components grow with each view, and states are compared.
    components = GrowingComponents()
    views: dict[str, NDArray[np.float64]] = {}
    for row in stored_views(context.kb):
        features = row.features(context.kb)
        if features is None:
            continue
        view, is_described = pooled(features.descriptors)
        if is_described:
            components.add(view)
            # One state an object: attempts are recorded of objects, not of their views.
            views.setdefault(row.object, view)
    return {object_iri: components.state(view).features for object_iri, view in views.items()}


@dataclass(frozen=True)
class Training:
    """What a learner learned in, and how far it came.

    Parameters
    ----------
    environment
        Name and version.
    episodes, mean_return
        How many, and the mean undiscounted return of the latest ones.
    """

    environment: str
    episodes: int
    mean_return: float


def keep_learner(
    context: Context,
    learner: Saved,
    name: str,
    agent: str | None = None,
    steps: int | None = None,
    training: Training | None = None,
) -> str:
    """Store a learner's state in the graph, replacing the one of this name and agent.

    Parameters
    ----------
    name
        Name under which it is resumed.
    agent
        Owner of the graph that keeps it; None = the shared graph.
    steps
        Number of learned steps.
    training
        Told with it, so that other robots find a policy for their environment.

    Returns
    -------
    IRI of the snapshot.
    """
    with ScratchFolder("learner") as folder:
        file = folder / "learner.npz"
        learner.save(file)
        blob = context.kb.blobs.put(file.read_bytes(), "application/x-npz")
    node = context.names.named("learner", f"{slug(agent or 'shared')}-{slug(name)}")
    triples = Triples()
    author = Access(agent, "robot") if agent else Access()
    triples.node(
        node,
        [RT.LearnerSnapshot],
        {
            RT.name: name,
            RT.algorithm: type(learner).__name__,
            RT.stepCount: steps,
            RT.learntIn: training.environment if training else None,
            RT.episodeCount: training.episodes if training else None,
            RT.meanReturn: training.mean_return if training else None,
            RT.hasBlob: triples.blob(blob),
            RT.atTime: stamp(dt.datetime.now(dt.UTC)),
            PROV.wasAttributedTo: context.agent_iri(author) if agent else None,
        },
    )
    home = context.kb.graphs.agent(agent) if agent else context.kb.graphs.shared
    # The former state goes in the same commit: a reader never finds two, or none.
    with context.writing, context.kb.transaction(access=author, note="a learner's state") as tx:
        for quad in context.kb.match(node, graph=home):
            tx.remove(quad.subject, quad.predicate, quad.object, home)
        for subject, predicate, value in triples:
            tx.add(subject, predicate, value, home)
    return node.value


def resume_learner(context: Context, learner: Saved, name: str) -> Resumed:
    """Load the latest state of this name and kind into a learner, if there is one.

    A state of another version, or with other states or actions, is not loaded; the note says why,
    and :func:`experience` allows learning from scratch.
    """
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?snapshot ?blob ?kind ?time WHERE {{
  ?snapshot a rt:LearnerSnapshot ; rt:name {literal(name)} ; rt:algorithm ?kind ;
    rt:hasBlob ?blob ; rt:atTime ?time
}} ORDER BY DESC(?time) DESC(?snapshot)""")
    return _first_that_fits(context, learner, rows, f"no learner {name!r} is stored")


def adopt_policy(context: Context, learner: Saved, environment: str) -> Resumed:
    """Load the policy of the robot that came farthest in an environment.

    As with :func:`resume_learner`, what does not fit is not loaded, and the note says why.

    What was withdrawn is not found, and the owner's policy stays as it is: whoever goes on learning
    keeps the result under its own name.
    """
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?snapshot ?blob ?kind ?return WHERE {{
  ?snapshot a rt:LearnerSnapshot ; rt:learntIn {literal(environment)} ; rt:algorithm ?kind ;
    rt:hasBlob ?blob ; rt:meanReturn ?return
}} ORDER BY DESC(?return) ?snapshot""")
    return _first_that_fits(context, learner, rows, f"no policy for {environment!r} is stored")


def _first_that_fits(
    context: Context, learner: Saved, rows: Iterable[Row], otherwise: str
) -> Resumed:
    kind, notes = type(learner).__name__, list[str]()
    for row in rows:
        where = str(row.value("snapshot"))
        # Arrays of another algorithm may fit by chance, and would mean something else.
        if str(row.value("kind")) != kind:
            notes.append(f"{where} is a {row.value('kind')}, not a {kind}")
            continue
        try:
            data = context.kb.blobs.read(iri(str(row.value("blob"))))
            with ScratchFolder("learner") as folder:
                file = folder / "learner.npz"
                file.write_bytes(data)
                learner.load(file)
        except (MissingBlobError, ValueError) as error:
            notes.append(f"{where}: {error}")
            continue
        return Resumed(True, "; ".join(notes), where)
    note = "; ".join(notes) or otherwise
    log.info("%s", note)
    return Resumed(False, note)
