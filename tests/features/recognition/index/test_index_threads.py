"""Queries in threads while another one adds and removes: never half a change."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from features.recognition import Recogniser, RecognitionIndex


@pytest.mark.slow
def test_two_threads_query_while_one_adds_and_removes(tmp_path, card_views) -> None:
    """An object that stays is found at every moment; a snapshot is consistent in itself."""
    index = RecognitionIndex(tmp_path / "index", seal_rows=2500)
    index.add("view:stays", "object:stays", "class:card", card_views(0, 1)[0])
    query = card_views(0, 2)[1]
    stop, failures, asked = threading.Event(), [], [0, 0]

    def ask(number: int) -> None:
        recogniser = Recogniser(index)
        while not stop.is_set():
            snapshot = index.snapshot()
            matches = snapshot.match(query.descriptors)
            views = matches.view[matches.view >= 0]
            if (
                len(snapshot.object_of_view) != len(snapshot.alive)
                or not snapshot.alive[views].all()
            ):
                failures.append("a view that is not there")
            answer = recogniser.recognise(query)
            if not answer.accepted or answer.matches[0].object_iri != "object:stays":
                failures.append(answer)
            asked[number] += 1

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    others = [card_views(card, 1)[0] for card in range(1, 6)]
    for k in range(30):
        index.add(f"view:{k}", f"object:{k}", "class:card", others[k % 5])
        if k % 3 == 2:
            index.remove(f"view:{k - 1}")
    stop.set()
    for thread in threads:
        thread.join()
    index.close()
    assert failures == []
    assert min(asked) > 0


def test_a_snapshot_stays_as_it_was(card_views) -> None:
    index = RecognitionIndex(seal_rows=1500)
    index.add("view:a", "object:a", "class:card", card_views(0, 1)[0])
    before = index.snapshot()
    answer = before.match(card_views(1, 1)[0].descriptors)
    for card in range(1, 6):
        index.add(f"view:{card}", f"object:{card}", "class:card", card_views(card, 1)[0])
    index.remove("view:a")
    again = before.match(card_views(1, 1)[0].descriptors)
    assert np.array_equal(answer.nearest, again.nearest)
    assert before.alive.tolist() == [True]
