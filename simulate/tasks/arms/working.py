"""A crew of whole arms carries out a goal: tables, robots, plan, and what truly came of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.scratch import ScratchFolder
from simulate.robots import check_robot
from simulate.tasks.actions import TaskAction
from simulate.tasks.arms.bench import Bench, Layout
from simulate.tasks.arms.body import ArmBody
from simulate.tasks.arms.introducing import Introduced, Planner, introduce, survey
from simulate.tasks.arms.layouts import SORTING, own_table, place_things, sorting_table
from simulate.tasks.crew import Crew, Ended
from simulate.tasks.executor import Executor, Turn
from simulate.world.camera import Lighting
from simulate.world.objects import Kind, sample_objects
from simulate.world.seeds import mix_seed, stream

__all__ = ["Settings", "Truth", "WholeCrew", "crew_at_tables", "layouts_of"]

_PRODUCTS, _TABLE, _LIGHT = range(90, 93)
_KINDS: tuple[Kind, ...] = ("can", "box", "bottle")
"""What is on the tables: kinds that stand, and that all hands can close on."""


@dataclass(frozen=True)
class Settings:
    """Tables, and what is on them.

    Parameters
    ----------
    tables
        The table of two Naos and a Panda, by :data:`SORTING`, or kinds of robots, each with a table
        of its own.
    things
        On each table.
    seed, preset
        Of all that is drawn, and of the physics.
    robot
        Name of the robot, if one alone is at a table of its own; by default robots are numbered.
    """

    tables: tuple[str, ...] = (SORTING,)
    things: int = 4
    seed: int = 0
    preset: str = "faithful"
    robot: str = ""


@dataclass(frozen=True)
class Truth:
    """Where a thing is in the graph, and in the physics.

    Parameters
    ----------
    name
        Of its product.
    remembered, place
        Names of the areas; empty for none.
    """

    name: str
    remembered: str
    place: str


@dataclass
class WholeCrew:
    """Robots at tables, known to the graph with all that stands there.

    Parameters
    ----------
    planner
        A client that may plan and state things.
    benches
        The tables.
    introduced
        The robots of each.
    """

    planner: Planner
    benches: Sequence[Bench]
    introduced: Sequence[Introduced]
    things: list[str] = field(default_factory=list)
    """IRIs of the things that the robots saw first."""
    repair_s: list[float] = field(default_factory=list)
    """Processor time of each repair of a plan, s."""

    @property
    def bodies(self) -> dict[str, ArmBody]:
        """All robots, by IRI."""
        return {iri: body for crew in self.introduced for iri, body in crew.bodies.items()}

    def work(
        self,
        tell: Callable[[str, Turn], None] = lambda robot, turn: None,
        may: Callable[[str], bool] = lambda text: True,
        agent: str | None = None,
        actions: Mapping[str, TaskAction] | None = None,
    ) -> list[Ended]:
        """Carry out all open plans; see :class:`simulate.tasks.crew.Crew`."""
        robots = {
            iri: Executor(self.planner, body, iri, may=may, actions=actions)
            for iri, body in self.bodies.items()
        }
        return Crew(self.planner, robots, tell, agent, repair_s=self.repair_s).work()

    def restart(self, killed: ArmBody) -> None:
        """Let another program take over a robot whose own was killed, with its arms as they are."""
        self.introduced = [
            replace(crew, bodies={iri: body.restarted() if body is killed else body
                                  for iri, body in crew.bodies.items()})
            for crew in self.introduced
        ]  # fmt: skip

    def truths(self) -> list[Truth]:
        """Return where each thing is, in the graph and in the physics, of the known products."""
        truths: list[Truth] = []
        for bench, crew in zip(self.benches, self.introduced, strict=True):
            placed = {bench.world.objects[laid.body].name: bench.area_of(laid.body)
                      for laid in bench.laid if laid.body in bench.world.objects}  # fmt: skip
            places = " ".join(f"<{place}>" for place in crew.places)
            remembered = {str(row["name"]): crew.places[str(row["place"])]
                     for row in self.planner.query(_WHERE % places)}  # fmt: skip
            truths += [
                Truth(name, remembered.get(name, ""), place) for name, place in placed.items()
            ]
        return truths


@contextmanager
def crew_at_tables(
    planner: Planner,
    settings: Settings,
    begin: Callable[[Bench], None] = lambda bench: None,
) -> Iterator[WholeCrew]:
    """Set up tables with robots and things, introduce the robots, and let them look around.

    Parameters
    ----------
    begin
        Called with each table before anything moves.
    """
    with ExitStack() as stack:
        benches, introduced, things = [], [], []
        for number, layout in enumerate(layouts_of(settings.tables, settings.robot)):
            assets = stack.enter_context(ScratchFolder("assets"))
            bench = _bench(layout, settings, number, assets)
            stack.callback(bench.close)
            seed = mix_seed(settings.seed, number)
            begin(bench)
            crew = introduce(planner, bench, seed)
            things += survey(planner, bench, crew)
            benches.append(bench)
            introduced.append(crew)
        yield WholeCrew(planner, benches, introduced, things)


def layouts_of(tables: Sequence[str], robot: str = "") -> list[Layout]:
    """Return the layouts of tables by their names.

    Parameters
    ----------
    robot
        Name of the one robot at the one table; by default robots are numbered.

    Raises
    ------
    RobotError
        There is no such kind of robot.
    UsageError
        A robot is named, and there is not just one.
    """
    if robot and (len(tables) != 1 or tables[0] == SORTING):
        raise UsageError(f"{robot} is one robot: name the kind of its table, such as panda or nao")
    layouts = []
    counts: dict[str, int] = {}
    for table in tables:
        if table == SORTING:
            layouts.append(sorting_table())
            continue
        check_robot(table)
        counts[table] = counts.get(table, 0) + 1
        layouts.append(own_table(robot or f"{table}-{counts[table]}", table))
    return layouts


def _bench(layout: Layout, settings: Settings, number: int, assets: Any) -> Bench:
    seed = settings.seed
    specs = sample_objects(stream(seed, _PRODUCTS, number), settings.things, _KINDS)
    placements = place_things(layout, specs, stream(seed, _TABLE, number))
    light = Lighting.sample(stream(seed, _LIGHT, number))
    return Bench(layout, placements, assets, settings.preset, light, (seed, number))


_WHERE = f"""{PREFIXES}
SELECT ?name ?place WHERE {{
  VALUES ?place {{ %s }} ?thing a rt:Exemplar ; rt:locatedOn ?place ; rt:exemplarOf/rt:name ?name
}}"""
