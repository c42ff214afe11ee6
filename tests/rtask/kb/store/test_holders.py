"""What was looked up of a change while others commit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import BlankNode, Literal, Quad, Store

from rtask.kb.store.apply import apply
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.overlay import Holders
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import iri, literal, triple_key

_G, _H, _I = (iri(f"urn:{name}") for name in "ghi")


def _quad(number: int, graph: object) -> Quad:
    return Quad(iri("urn:s"), iri("urn:p"), literal(number), graph)  # type: ignore[arg-type]


class _CountingStore(EmbeddedStore):
    """Counts what is looked up."""

    __slots__ = ("looked_up",)

    def __init__(self) -> None:
        super().__init__(Store())
        self.looked_up = 0

    def holders(self, key: object) -> list[object]:  # type: ignore[override]
        self.looked_up += 1
        return super().holders(key)  # type: ignore[arg-type, return-value]


def test_a_triple_is_looked_up_once_until_something_changes() -> None:
    store = _CountingStore()
    apply(store, Writes(added=[_quad(1, _G), _quad(1, _H), _quad(255, _G), _quad(256, _H)]))
    holders = Holders(store)

    for _ in range(2):
        assert set(holders.of(triple_key(_quad(1, _G)))) == {_G, _H}
        assert list(holders.of(triple_key(_quad(255, _G)))) == [_G]
    assert store.looked_up == 2

    apply(store, Writes(removed=[_quad(1, _H)]))

    assert list(holders.of(triple_key(_quad(1, _G)))) == [_G]


def test_what_others_leave_alone_is_kept_while_their_changes_are_followed() -> None:
    store = _CountingStore()
    apply(store, Writes(added=[_quad(1, _G), _quad(2, _G)]))
    holders = Holders(store)
    holders.follow()
    assert [list(holders.of(triple_key(_quad(n, _G)))) for n in (1, 2)] == [[_G], [_G]]

    apply(store, Writes(added=[_quad(2, _H), _quad(3, _H)], removed=[_quad(2, _G)]))

    assert list(holders.of(triple_key(_quad(1, _G)))) == [_G]
    assert store.looked_up == 2
    assert list(holders.of(triple_key(_quad(2, _G)))) == [_H]
    assert store.looked_up == 3

    store.tell(Writes(is_replacement=True))
    assert list(holders.of(triple_key(_quad(1, _G)))) == [_G]
    assert store.looked_up == 4

    holders.unfollow()
    apply(store, Writes(added=[_quad(1, _I)]))
    assert set(holders.of(triple_key(_quad(1, _G)))) == {_G, _I}


@pytest.mark.parametrize("on_disk", [False, True])
def test_triples_looked_up_at_once_are_found_as_one_by_one(tmp_path: Path, on_disk: bool) -> None:
    store = EmbeddedStore(Store(str(tmp_path / "store")) if on_disk else Store())
    node = BlankNode("b1")
    shared = [_quad(n, graph) for n in (1, 255, 256, 511) for graph in (_G, _H)]
    more = [Quad(s, iri(f"urn:p{n}"), node, _G) for s in (node, iri("urn:t")) for n in range(60)]
    apply(store, Writes(added=[*shared, *more]))
    same_value = Literal("01", datatype=iri("http://www.w3.org/2001/XMLSchema#int"))
    written = Quad(iri("urn:s"), iri("urn:p"), same_value, _G)
    keys = [triple_key(q) for q in (*shared, *more[::7], written, _quad(7, _G), _quad(8, _G))]

    assert {key: set(graphs) for key, graphs in store.holders_of_each(keys).items()} == {
        key: set(store.holders(key)) for key in keys
    }


def test_what_changes_while_much_is_looked_up_is_looked_up_again() -> None:
    store = _CountingStore()
    apply(store, Writes(added=[_quad(1, _G), _quad(2, _G), _quad(3, _G)]))
    holders = Holders(store)
    holders.follow()

    @contextlib.contextmanager
    def changing() -> Iterator[None]:
        apply(store, Writes(added=[_quad(2, _H)]))  # read before, and changed before the lock
        yield

    holders.find_meanwhile([triple_key(_quad(n, _G)) for n in (1, 2, 3)], changing)

    found = [set(holders.of(triple_key(_quad(n, _G)))) for n in (1, 2, 3)]
    assert found == [{_G}, {_G, _H}, {_G}]
    assert store.looked_up == 1


def test_what_was_read_of_a_subject_is_not_looked_up_again() -> None:
    store = _CountingStore()
    apply(store, Writes(added=[_quad(1, _G), _quad(1, _H), _quad(2, _H)]))
    holders, read = Holders(store), list(store.quads_for_pattern(iri("urn:s"), None, None))

    holders.learn([read], store.writes)

    assert set(holders.of(triple_key(_quad(1, _G)))) == {_G, _H}
    assert list(holders.of(triple_key(_quad(2, _G)))) == [_H]
    assert store.looked_up == 0


def test_what_was_read_before_others_wrote_is_not_used() -> None:
    store = _CountingStore()
    apply(store, Writes(added=[_quad(1, _G), _quad(1, _H)]))
    read, writes = list(store.quads_for_pattern(iri("urn:s"), None, None)), store.writes
    apply(store, Writes(removed=[_quad(1, _H)]))
    holders = Holders(store)

    holders.learn([read], writes)

    assert list(holders.of(triple_key(_quad(1, _G)))) == [_G]
