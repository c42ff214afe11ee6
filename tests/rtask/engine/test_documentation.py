"""The pages on operations name each one and its fields; the page on learning, every number."""

from __future__ import annotations

import re
from pathlib import Path

from rtask.engine import Policy
from rtask.engine.operations.table import OPERATIONS
from rtask.wire.fields import kind_of

DOCS = Path(__file__).resolve().parents[3] / "docs"


def sections(text):
    """Return the page's parts by heading."""
    parts = re.split(r"(?m)^## (.+)$", text)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def names(message):
    for name, field in message.model_fields.items():
        yield name
        part = kind_of(field).message
        if part is not None:
            yield from names(part)


def test_every_operation_has_a_section_that_names_every_field():
    overview, people = ((DOCS / name).read_text("utf-8") for name in ("engine.md", "curation.md"))
    described = sections(overview) | sections(people)
    for operation in OPERATIONS.values():
        text = described[operation.name]
        missing = [name for name in names(operation.request) if f"`{name}`" not in text]
        if operation.name == "report_outcome":  # its outcome is described with insert_object
            text += described["insert_object"]
            missing = [name for name in missing if f"`{name}`" not in text]
        assert not missing, operation.name
        assert f" | {operation.scope} | {operation.effect} | {operation.summary} |" in overview


def test_every_operation_has_a_section_that_names_every_field_of_its_answer():
    described = sections((DOCS / "engine.md").read_text("utf-8"))
    described |= sections((DOCS / "curation.md").read_text("utf-8"))
    described["teach_object"] += described["search_object"]  # "as in `search_object`"
    for operation in OPERATIONS.values():
        fields = [name.rstrip("_") for name in operation.answer.model_fields]  # class_ is `class`
        missing = [name for name in fields if f"`{name}`" not in described[operation.name]]
        assert not missing, operation.name


def test_the_defaults_on_the_page_about_learning_are_those_of_the_policy():
    text = (DOCS / "learning.md").read_text(encoding="utf-8")
    policy = Policy()
    for words in (
        f"quality from geometry and its weight in attempts | {policy.bandit.kappa:g} |",
        f"cap {policy.bandit.cap:g} |",
        f"fails in the same way again | {policy.bandit.rho:g} |",
        f"h = {policy.bandit.bandwidth:g}",
        f"confidence of recognition / {policy.same_class:g}",
        f"lost by a weaker one | {policy.doubtful_transfer:g} |",
        f"either force is unknown | {policy.other_gripper:g} |",
        f"1 / {policy.fast_physics:g} for a robot",
        f"a factor of {policy.size_tolerance:g}",
        f"at least {policy.bandit.proven_weight:g} of a success",
        f"If no mean reaches {policy.bandit.stop_below:g}",
    ):
        assert words in text, words
