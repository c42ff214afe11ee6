"""Instructions hidden in what robots stored, obeyed to the letter, change nothing of others."""

from __future__ import annotations

from unittest import mock

import pytest

from rtask.knowledge_base import KnowledgeBase
from tests.endpoint.api import obedient_agent
from tests.endpoint.api.hidden_places import (
    PLACES,
    PlacedAgent,
    placed_instructions,
    store_in_places,
)
from tests.endpoint.api.obedient_agent import (
    COUNT,
    ObedientAgent,
    application_with_instructions,
    of_others,
)
from tests.endpoint.api.styled_instructions import StyledAgent, styled_instructions

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


@pytest.mark.deep
def test_instructions_in_other_styles_change_nothing_of_others_either() -> None:
    texts = styled_instructions()
    with (
        mock.patch.object(obedient_agent, "instructions", return_value=texts),
        application_with_instructions() as application,
    ):
        agent = StyledAgent(application)
        before = of_others(application.context.kb)
        agent.read_and_obey()
        assert len(agent.obeyed) == len(texts) == 50
        assert of_others(application.context.kb) == before
        assert agent.misplaced == []


@pytest.mark.deep
def test_instructions_in_other_places_change_nothing_of_others_either() -> None:
    with (
        mock.patch.object(obedient_agent, "instructions", return_value=[]),
        application_with_instructions() as application,
    ):
        kb = application.context.kb
        assert isinstance(kb, KnowledgeBase)
        stored = store_in_places(kb)
        assert {place for place, _ in placed_instructions()} == set(PLACES)
        agent = PlacedAgent(application)
        before = of_others(kb)
        agent.read_and_obey()
        assert agent.obeyed >= set(stored)
        assert of_others(kb) == before
        assert not kb.rules()
        # An address has to be given as it is; it stands alone, never in a sentence.
        assert [text for text in agent.misplaced if " " in text or "(" in text] == []
