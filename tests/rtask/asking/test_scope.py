"""Questions that none of the ontology's answers: an answer to the nearest would be to another."""

from __future__ import annotations

import pytest

import rtask
from rtask.asking.questions import answer
from rtask.asking.questions.scope import command
from rtask.knowledge_base import KnowledgeBase


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Which objects are not red?", "what is denied ('not … red')"),
        ("Which robots can't hold the pen?", "what is denied ("),
        ("Which grasps aren't proven?", "what is denied ("),
        ("Which robots never failed?", "what is denied ('never … failed')"),
        ("Put the mug into the box", "That tells a robot to do something, and nothing was done"),
        ("Could you bring me the mug please", "That tells a robot to do something"),
        ("How are you?", "Nothing in these words says what is asked for"),
        ("Which cameras are connected?", "The nearest question is not about 'cameras'"),
        ("How often was the mug washed?", "None of the questions is about 'washed'"),
        ("How hot is the mug?", "None of the questions is "),
        ("Is the mug clean?", "Whether something is so is not what the nearest question asks"),
        ("Which robots can talk to each other?", "None of the questions is about 'talk' here"),
        ("What did people grasp yesterday?", "None of the questions is about 'people' here"),
        ("What time is it?", "What is meant by the last word is not said"),
        ("What will happen tomorrow?", "not what would or will be"),
        ("How do I add a robot?", "told by the documentation"),
        ("How does the learner work?", "told by the documentation"),
        ("How heavy is nao?", "How heavy something is, is not what"),
        ("How loud is nao?", "None of the questions is about 'loud'"),
        ("Where is nao right now?", "Where a robot is itself is not stated"),
        ("Where was the mug produced?", "Who made or owns a thing"),
        ("What will pr2 do next?", "not what will or should be"),
        ("Which robot do you like?", "What somebody likes"),
        ("How sharp are the pictures?", "How sharp something is"),
        ("What would happen if nao dropped the mug?", "not what would or will be"),
    ],
)
def test_what_means_none_of_the_questions_is_not_answered(
    kb: KnowledgeBase, text: str, why: str
) -> None:
    found = answer(kb, text)
    assert not found.is_understood, (found.key, found.sentence)
    assert why in found.sentence
    assert found.sentence.endswith(
        f"The nearest are: {'; '.join(item.question for item in found.nearest)}"
    )
    assert len(found.nearest) == 3


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("Which objects were never held?", "eq12"),
        ("Why did nao not grasp the mug?", "cq21"),
        ("why didn't nao take the mug?", "cq21"),
        ("Which grasps work for one robot and not for another?", "eq10"),
        ("Bring me something to write with", "cq24"),
        ("Which poses are no longer valid?", "eq15"),
        ("Take me through what each robot tried with each object, in order", "eq02"),
        ("waht boxes are there", "cq04"),
        ("which grasps are stored for pens", "cq13"),
    ],
)
def test_denials_wishes_and_misspelt_words_of_the_questions_are_answered(
    kb: KnowledgeBase, text: str, key: str
) -> None:
    found = answer(kb, text)
    assert found.key == key, found.sentence


def test_nouns_and_requests_for_information_are_no_commands() -> None:
    asked = ["grasp success rates per robot", "place of the mug", "give me the pose of the mug",
             "move history of the mug", "hand of nao", "grasps of the mug"]  # fmt: skip
    assert not any(command(text) for text in asked)
    assert command("nao, lift the box")
    assert command("Let nao hold the mug")


@pytest.mark.parametrize(
    "text", ["Where is pen-777?", "how heavy is pen 777", "what is kb:object/777?"]
)
def test_a_number_that_nothing_has_is_not_answered_about_others(
    kb: KnowledgeBase, text: str
) -> None:
    found = answer(kb, text)
    assert not found.is_understood
    assert found.sentence.startswith("Nothing in the graph is called '")
    assert "777'" in found.sentence


def test_a_number_may_stand_apart_from_its_word() -> None:
    with rtask.open(":memory:", reason=False) as kb:
        kb.update(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
            'INSERT DATA { <urn:6> a rt:ManipulableObject ; rt:name "carton-6" . '
            '<urn:7> a rt:ManipulableObject ; rt:name "carton-7" }'
        )
        found = answer(kb, "where is carton 6?")
    assert found.filled["object"] == ("carton 6", ("<urn:6>",))


def test_a_superlative_is_not_passed_over_in_silence(kb: KnowledgeBase) -> None:
    found = answer(kb, "how wide is the tallest pen?")
    assert found.key == "cq28"
    assert "Not considered: tallest." in found.sentence


@pytest.mark.parametrize("word", ["fials", "fails"])
def test_neighbouring_letters_that_changed_places_are_put_right(
    kb: KnowledgeBase, word: str
) -> None:
    assert answer(kb, f"which robot {word} at pens").nearest[0].key == "eq25"
