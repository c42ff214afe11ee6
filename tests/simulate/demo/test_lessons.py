"""Lessons recalled of lessons won: the last robot's first grasps against the others' successes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simulate.demo.lessons import closed_where_held, lessons_of
from simulate.demo.report import write_report


def _attempt(source: str, held: bool = True, **more: Any) -> dict[str, Any]:
    place = "ok" if held else ""
    return {"source": source, "held": held, "physical": True, "place_reason": place, **more}


def _met(product: str, *attempts: dict[str, Any]) -> dict[str, Any]:
    held = any(attempt["held"] for attempt in attempts)
    return {
        "product": product, "tries": len(attempts), "held": held, "placed": held, "right": None,
        "tries_to_success": len(attempts) if held else None, "attempts": list(attempts),
    }  # fmt: skip


def _robot(name: str, *met: dict[str, Any]) -> dict[str, Any]:
    return {"name": name, "encounters": list(met)}


def test_a_lesson_counts_as_recalled_if_the_first_attempt_is_from_the_graph() -> None:
    teacher = _robot(
        "panda-1",
        _met("carton", _attempt("candidate", held=False), _attempt("candidate")),
        _met("flask", _attempt("candidate", held=False), _attempt("scene")),
        _met("bar", _attempt("scene")),
        _met("lost", _attempt("candidate", held=False)),
    )
    pupil = _robot(
        "panda-2",
        _met("carton", _attempt("none", held=False, physical=False), _attempt("memory")),
        _met("flask", _attempt("candidate", held=False), _attempt("memory")),
        _met("bar", _attempt("memory")),
        _met("lost", _attempt("memory")),
    )
    lessons = lessons_of([teacher, pupil])
    assert lessons is not None
    assert (lessons.won, lessons.recalled) == (3, 2)
    assert (lessons.won_in_space, lessons.recalled_in_space) == (2, 1)
    assert lessons.sentence() == (
        "Of 3 products that another robot had held before, panda-2 began with the remembered "
        "grasp at 2 (of 2 held with a grasp planned on the whole view, at 1)."
    )


def test_a_grasp_of_its_own_where_a_success_counts_follows_the_lesson() -> None:
    teacher = _robot("nao-1", *(_met(name, _attempt("candidate")) for name in "abcd"))
    there, elsewhere = _attempt("candidate", told=(0.9, 0.0)), _attempt("scene", told=(0.2, 1.0))
    pupil = _robot(
        "panda-2",
        _met("a", there) | {"recognised": "urn:a"},
        _met("b", elsewhere) | {"recognised": "urn:b"},
        _met("c", there) | {"recognised": ""},  # the evidence is that of another thing
        _met("d", _attempt("memory", told=(1.0, 0.0))) | {"recognised": "urn:d"},
    )
    lessons = lessons_of([teacher, pupil])
    assert lessons is not None
    assert (lessons.won, lessons.recalled, lessons.followed) == (4, 1, 1)
    assert lessons.elsewhere == {"b": True, "c": True}
    assert lessons.sentence() == (
        "Of 4 products that another robot had held before, panda-2 began with the remembered "
        "grasp at 1, and with a grasp of its own at the same place at 1."
    )


def test_a_remembered_grasp_out_of_reach_is_told_from_one_that_the_graph_did_not_offer() -> None:
    teacher = _robot("nao-1", *(_met(name, _attempt("candidate")) for name in "abc"))
    pupil = _robot(
        "nao-2",
        _met("a", _attempt("candidate", first_offered="memory")),
        _met("b", _attempt("candidate", first_offered="candidate")),
        _met("c", _attempt("memory", first_offered="memory")),
    )
    lessons = lessons_of([teacher, pupil])
    assert lessons is not None
    assert (lessons.won, lessons.recalled, lessons.unreachable) == (3, 1, 1)
    assert lessons.to_dict()["unreachable"] == 1


def test_a_lesson_was_used_where_the_hand_first_closed_as_one_had_held() -> None:
    def at(along_m: float, held: bool = True) -> dict[str, Any]:
        return _attempt("candidate", held, hand={"along_m": along_m})

    first = _robot("nao-1", _met("a", at(0.03, held=False), at(-0.03)), _met("b", at(0.0)))
    second = _robot("nao-2", _met("a", at(0.01)), _met("b", at(0.04)), _met("c", at(0.0)))
    known = {"recognised": "urn:it"}
    third = _robot(
        "panda-3", _met("a", at(0.017)) | known, _met("b", at(0.02)) | known,
        _met("c", at(0.0)),  # by luck, as it was not recognised
    )  # fmt: skip
    lessons = lessons_of([first, second, third])
    assert lessons is not None
    assert (lessons.won, lessons.same_place, lessons.places) == (3, 1, 3)
    assert closed_where_held([first, second], third, knows_by_sight=False) == (2, 3)
    unseen = _robot("panda-3", _met("a", _attempt("memory")) | known)
    assert closed_where_held([first], unseen) == (0, 1)


def test_the_way_in_which_a_product_was_first_won_counts() -> None:
    first = _robot("panda-1", _met("bar", _attempt("scene")))
    second = _robot("panda-2", _met("bar", _attempt("memory")))
    lessons = lessons_of([first, second, _robot("panda-3", _met("bar", _attempt("memory")))])
    assert lessons is not None
    assert (lessons.won, lessons.won_in_space, lessons.recalled_in_space) == (1, 1, 1)


def test_what_was_lost_on_the_way_or_never_met_again_is_no_lesson() -> None:
    fell = _attempt("candidate", place_reason="slip_transport")
    teacher = _robot("nao-1", _met("can", fell), _met("tin", _attempt("candidate")))
    lessons = lessons_of([teacher, _robot("nao-2", _met("can", _attempt("memory")))])
    assert lessons is not None
    assert (lessons.won, lessons.recalled) == (0, 0)
    assert lessons_of([teacher]) is None


def test_the_report_says_how_many_lessons_arrived(tmp_path: Path) -> None:
    done = [_robot(name, _met("bar", _attempt(source)))
            for name, source in (("panda-1", "scene"), ("panda-2", "memory"))]  # fmt: skip
    lessons = lessons_of(done)
    assert lessons is not None
    write_report(tmp_path, {"robots": [], "lessons": lessons.to_dict()}, [], [])
    for name in ("report.md", "report.html", "report.json"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert "Of 1 product that another robot had held before, panda-2 began with" in text
