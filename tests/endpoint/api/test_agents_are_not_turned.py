"""Instructions hidden in what robots stored, obeyed to the letter, change nothing of others."""

from __future__ import annotations

import pytest

from rtask.knowledge_base import KnowledgeBase
from tests.endpoint.api.obedient_agent import (
    COUNT,
    ObedientAgent,
    application_with_instructions,
    of_others,
)

pytestmark = pytest.mark.slow  # opens the ontology


def test_two_hundred_hidden_instructions_change_nothing_of_others() -> None:
    with application_with_instructions() as application:
        kb = application.context.kb
        assert isinstance(kb, KnowledgeBase)
        agent = ObedientAgent(application)
        before = of_others(kb)
        agent.read_and_obey()
        assert len(agent.obeyed) == COUNT
        assert not agent.misplaced
        assert of_others(kb) == before
        assert not kb.rules()
        assert {one.author for one in kb.proposals.find()} == {"nao"}
        assert not kb.proposals.find("adopted")
