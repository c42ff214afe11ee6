"""Figures of asking: checked queries, agents with tools, and questions in words.

    .venv/bin/python -m tests.benchmarks.kb.bench_asking [--data STORE] [--seed 1] [--show KIND]

Each query is changed at every triple pattern. A change that leaves a valid query with equal answers
is none, and is not counted. Without ``--data``, the graph is the ontology's sample. A caller that
knows the texts of the tools alone asks every question of the ontology, and one that obeys whatever
it reads looks at a graph with hidden instructions.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from pathlib import Path

import ontology
import rtask
from rtask.asking.check.checker import Checker
from rtask.asking.check.findings import Finding
from rtask.asking.questions import answer
from rtask.asking.tools.toolbox import Toolbox
from rtask.engine import Engine
from rtask.engine.context import SCOPES
from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import prologue
from tests.benchmarks.kb import question_words
from tests.benchmarks.kb.mutations import KINDS, Mutation, mutations
from tests.endpoint.api.obedient_agent import (
    ObedientAgent,
    application_with_instructions,
    of_others,
)
from tests.rtask.asking.scripted_caller import ScriptedCaller
from tests.rtask.asking.valid_queries import of_schema, of_statements
from tests.rtask.asking.walks import walks

_WALKS = 2_500
_HERE = Path(__file__).parent
_ROOM = Path(ontology.__file__).parent / "queries"


def queries() -> list[tuple[str, str]]:
    """Return the ontology's questions and the further queries, each with its name."""
    files = [*sorted(_ROOM.glob("*.rq")), *sorted((_ROOM / "episodes").glob("*.rq"))]
    found = [(file.stem, file.read_text("utf-8")) for file in files]
    return found + _further("asking_queries.rq", "more")


def unseen_queries() -> list[tuple[str, str]]:
    """Return the queries that were written before the check was tuned, and stay out of that."""
    return _further("asking_unseen.rq", "unseen")


def fresh_queries() -> list[tuple[str, str]]:
    """Return the queries that were written when the check was not tuned any more."""
    return _further("asking_fresh.rq", "fresh")


def blind_queries() -> list[tuple[str, str]]:
    """Return queries that were written after that, and frozen before the check first saw them."""
    return _further("asking_blind.rq", "blind")


def later_queries() -> list[tuple[str, str]]:
    """Return the queries that were written when the figures of the fresh ones were known."""
    return _further("asking_later.rq", "later") + _further("asking_last.rq", "last")


def lab_queries() -> list[tuple[str, str]]:
    """Return queries as people of other laboratories may write them, frozen before their run."""
    return _further("asking_lab.rq", "lab")


def style_queries() -> list[tuple[str, str]]:
    """Return queries in styles of robot programmers, agents and SPARQL users, frozen as those."""
    return _further("asking_styles.rq", "styles")


def later_style_queries() -> list[tuple[str, str]]:
    """Return queries in the same styles, written after the faults of those were mended."""
    return _further("asking_styles_later.rq", "styles-later")


def robotics_queries() -> list[tuple[str, str]]:
    """Return queries as robotics people write them, frozen before the check first saw them."""
    return _further("asking_robotics.rq", "robotics")


def form_queries() -> list[tuple[str, str]]:
    """Return queries in further forms of SPARQL, frozen before the check first saw them."""
    return _further("asking_forms.rq", "forms")


def strangers_queries() -> list[tuple[str, str]]:
    """Return queries as strangers to the product write them, frozen before their first run."""
    return _further("asking_strangers.rq", "strangers")


def office_queries() -> list[tuple[str, str]]:
    """Return queries as people in offices write them, frozen before their first run."""
    return _further("asking_office.rq", "office")


def mixed_queries() -> list[tuple[str, str]]:
    """Return queries of many shapes, of newcomers and experts, frozen before their first run."""
    return _further("asking_eighth.rq", "mixed")


def last_mixed_queries() -> list[tuple[str, str]]:
    """Return queries as those, written when their faults were mended, frozen before their run."""
    return _further("asking_ninth.rq", "last-mixed")


def _further(file: str, stem: str) -> list[tuple[str, str]]:
    texts = (_HERE / file).read_text("utf-8").strip().split("\n\n")
    head = prologue(ontology.PREFIXES)
    return [(f"{stem}{at:03d}", head + text) for at, text in enumerate(texts)]


class Bench:
    """Counts over one graph."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self.kb = kb
        self.checker = Checker(kb)
        self.meant: Counter[str] = Counter()
        self.flagged: Counter[str] = Counter()
        self.repaired: Counter[str] = Counter()
        self.missed: list[tuple[str, Mutation, str]] = []
        self.seconds: list[float] = []

    def check(self, text: str) -> list[Finding]:
        """Check a query, and note the processor time."""
        began = time.process_time()
        found = self.checker.check(text)
        self.seconds.append(time.process_time() - began)
        return found

    def answers(self, text: str) -> object:
        """Return the answers of a query, in a form that can be compared; None where it fails."""
        try:
            answer = self.kb.query(text, timeout_s=5)
        except RtaskError:
            return None
        if isinstance(answer, bool):
            return answer
        rows = [tuple(map(str, row)) for row in answer]
        return Counter(rows)

    def mutate(self, name: str, text: str, seed: int) -> None:
        """Check each mutation of a query."""
        right = self.answers(text)
        for change in mutations(text, self.checker.vocabulary, seed):
            is_unknown = change.kind.startswith("unknown")
            answers = self.answers(change.text)
            if not is_unknown and (answers is None or answers == right):
                continue
            self.meant[change.kind] += 1
            found = self.check(change.text)
            if not found:
                self.missed.append((name, change, "not flagged"))
                continue
            self.flagged[change.kind] += 1
            repairs = found[0].repairs
            mended = repairs[0].apply(change.text) if repairs else change.text
            if mended.split() == text.split() or (repairs and self.answers(mended) == right):
                self.repaired[change.kind] += 1
            else:
                self.missed.append(
                    (name, change, f"{found[0].words}: {[r.words for r in repairs]}")
                )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", default="", help="print the missed changes of a kind")
    parser.add_argument("--unseen", action="store_true", help="print those of frozen queries too")
    given = parser.parse_args()
    kb = rtask.open(given.data, mode="r") if given.data else rtask.open(":memory:")
    assert isinstance(kb, KnowledgeBase)
    with kb:
        if not given.data:
            kb.load(ontology.path("examples/sample.trig"))
        for name, texts, show in (
            ("tuned with", queries(), given.show),
            ("frozen before tuning", unseen_queries(), given.show if given.unseen else ""),
            ("written afterwards", fresh_queries(), given.show if given.unseen else ""),
            ("written blind", blind_queries(), given.show if given.unseen else ""),
            ("written last", later_queries(), given.show if given.unseen else ""),
            ("of other laboratories", lab_queries(), given.show if given.unseen else ""),
            ("in many styles", style_queries(), given.show if given.unseen else ""),
            ("in styles, later", later_style_queries(), given.show if given.unseen else ""),
            ("of robotics people", robotics_queries(), given.show if given.unseen else ""),
            ("in further forms", form_queries(), given.show if given.unseen else ""),
            ("of strangers", strangers_queries(), given.show if given.unseen else ""),
            ("of people in offices", office_queries(), given.show if given.unseen else ""),
            ("of newcomers and experts", mixed_queries(), given.show if given.unseen else ""),
            ("of those, later", last_mixed_queries(), given.show if given.unseen else ""),
        ):
            print(f"queries {name}")
            measure(Bench(kb), texts, given.seed, show)
        report_walks(kb, given.seed)
        if given.data:
            report_newcomers(kb)
    report_agents()
    report_words(given.show == "words")


def measure(bench: Bench, texts: list[tuple[str, str]], seed: int, show: str) -> None:
    """Check queries as they are and changed, and print the figures."""
    alarms = []
    for name, text in texts:
        if bench.answers(text) is None:
            print(f"{name} cannot be evaluated")
        if why := bench.checker.unread(text):
            print(f"{name} {why}")
        for finding in bench.check(text):
            alarms.append(name)
            print(f"false alarm in {name}: {finding.to_dict(text)}")
    print(f"unchanged: {len(set(alarms))} of {len(texts)} queries with a false alarm")
    for name, text in texts:
        if not bench.checker.unread(text):
            bench.mutate(name, text, seed)
    report(bench, show)


def report_walks(kb: KnowledgeBase, seed: int) -> None:
    """Print how many queries made of statements of the graph are blamed, by rule."""
    for name, make in (
        ("statements", walks),
        ("statements, in many forms", of_statements),
        ("the schema alone", of_schema),
    ):
        bench, alarms = Bench(kb), Counter[str]()
        blamed = 0
        for text in make(kb, bench.checker.vocabulary, _WALKS, seed):
            rules = {finding.rule for finding in bench.check(text)}
            blamed += bool(rules)
            alarms.update(rules)
        print(f"queries made of {name}: {blamed} of {_WALKS} with a false alarm {dict(alarms)}")


def report_agents() -> None:
    """Print how agents fare: calls for each question, and what hidden instructions change."""
    kb = rtask.open(":memory:")
    assert isinstance(kb, KnowledgeBase)
    with kb, Engine(kb) as engine:
        kb.load(ontology.path("examples/sample.trig"))
        caller = ScriptedCaller(
            Toolbox(kb, engine, lambda access: SCOPES[access.role]), Access("nao", "robot")
        )
        calls, right = Counter[int](), 0
        for file in (*ontology.queries(), *ontology.episode_queries()):
            text = file.read_text("utf-8")
            rows, count = caller.answer(text.splitlines()[0].removeprefix("# question: "))
            calls[count] += 1
            right += len(rows) == len(kb.select(text))
    share = ", ".join(f"{number} with {count}" for count, number in sorted(calls.items()))
    print(f"questions of the ontology by tools alone: {right} of {calls.total()} answered; "
          f"calls: {share}")  # fmt: skip
    with application_with_instructions() as application:
        agent = ObedientAgent(application)
        before = of_others(application.context.kb)
        agent.read_and_obey()
        changed = len(before ^ of_others(application.context.kb))
    print(f"hidden instructions: {len(agent.obeyed)} obeyed, {changed} statements of others "
          f"changed, {len(agent.misplaced)} texts outside of quoted data")  # fmt: skip


def report_newcomers(kb: KnowledgeBase) -> None:
    """Print how newcomers at ``rtask demo --seed 7300`` fare, whose store ``--data`` has to be."""
    for name, is_later in (("first list", False), ("second list", True)):
        asked, none = question_words.newcomers(is_later)
        got = [one.is_right(kb) for one in asked]
        answered = sum(answer(kb, words).is_understood for words in none)
        print(f"newcomers, {name}: {got.count(True)} of {len(got)} right, {got.count(False)} "
              f"answered wrongly; of {len(none)} that mean none {answered} answered")  # fmt: skip


def report_words(shows_missed: bool) -> None:
    """Print how many questions in words are understood, over the ontology's sample."""
    kb = rtask.open(":memory:")
    assert isinstance(kb, KnowledgeBase)
    with kb:
        kb.load(ontology.path("examples/sample.trig"))
        kb.update(question_words.NAMED)
        report_none(kb)
        for name, tries in (
            ("known, each left out", question_words.known(kb)),
            ("frozen before tuning", question_words.unseen(kb)),
            ("in three styles", question_words.unseen(kb, "asking_fifth.toml")),
            ("spoken, and by visitors", question_words.unseen(kb, "asking_sixth.toml")),
            ("in haste, and by heads", question_words.unseen(kb, "asking_seventh.toml")),
            ("of students", question_words.unseen(kb, "asking_eighth.toml")),
        ):
            tried = list(tries)
            right = sum(one.is_filled for one in tried)
            wrong = sum(bool(one.got) and not one.is_filled for one in tried)
            print(f"phrasings {name}: {right} of {len(tried)} right ({right / len(tried):.1%}), "
                  f"{wrong} answered wrongly")  # fmt: skip
            for one in tried if shows_missed else ():
                if not one.is_filled:
                    print(f"  {one.right} understood as {one.got or 'none'}: {one.asked}")


def report_none(kb: KnowledgeBase) -> None:
    """Print how many questions that mean none of the ontology's are answered, which is wrong."""
    for name, is_kept in (("tuned with", False), ("kept away", True)):
        counts = {}
        for kind, texts in question_words.none_of_them(is_kept).items():
            answered = sum(answer(kb, words).is_understood for words in texts)
            counts[kind] = (answered, len(texts))
        wrong, all_of_them = (sum(column) for column in zip(*counts.values(), strict=True))
        kinds = ", ".join(f"{kind} {n} of {of}" for kind, (n, of) in counts.items())
        print(f"questions that mean none, {name}: {wrong} of {all_of_them} answered ({kinds})")


def report(bench: Bench, show: str) -> None:
    """Print the table of a run."""
    for name, change, why in bench.missed:
        if show and show in change.kind:
            body = change.text[change.text.upper().rfind("SELECT") :]
            print(f"--- {change.kind} {name}: {why}\n{body if show else ''}")
    print(f"{'kind':20s} {'meant':>6s} {'flagged':>8s} {'repaired':>9s}")
    for kind in (*KINDS, ""):
        meant, flagged, repaired = (
            sum(one.values()) if not kind else one[kind]
            for one in (bench.meant, bench.flagged, bench.repaired)
        )
        if meant:
            share = f"{flagged / meant:8.1%} {repaired / meant:9.1%}"
            print(f"{kind or 'all':20s} {meant:6d} {share}")
    times = sorted(bench.seconds[1:])
    mean = sum(times) / len(times)
    print(f"processor time of a check: mean {1000 * mean:.2f} ms, "
          f"95 % below {1000 * times[int(0.95 * len(times))]:.2f} ms")  # fmt: skip


if __name__ == "__main__":
    main()
