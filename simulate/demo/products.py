"""Products of a demo: the work of a robot at each, and what their labels say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rtask.client import Client

__all__ = ["by_product", "state_kinds"]


def by_product(encounters: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Join the encounters with the same product, such as one that was lost and found again."""
    joined: list[dict[str, Any]] = []
    first: dict[str, dict[str, Any]] = {}
    for encounter in encounters:
        earlier = first.get(encounter["product"]) if encounter["product"] else None
        if earlier is None:
            joined.append(dict(encounter))
            first[encounter["product"]] = joined[-1]
            continue
        if earlier["tries_to_success"] is None and encounter["tries_to_success"] is not None:
            earlier["tries_to_success"] = earlier["tries"] + encounter["tries_to_success"]
        earlier["tries"] += encounter["tries"]
        earlier["held"] |= encounter["held"]
        earlier["placed"] |= encounter["placed"]
        earlier["attempts"] = [*earlier.get("attempts", ()), *encounter.get("attempts", ())]
        if encounter.get("right") is False:  # trials of single objects know no identities
            earlier["right"] = False
    return joined


def state_kinds(client: Client, products: Mapping[str, str]) -> None:
    """State of each object in the graph what its label says it is: a carton, a rod.

    A camera tells some kinds from the shape and leaves others open. This comes after the robots
    have worked, so that no decision of theirs depends on it.

    Parameters
    ----------
    client
        Connection of a teacher.
    products
        Name of the product behind each object; those of the empty name stand for none.
    """
    for iri, product in products.items():
        if product:
            kind = product.partition("-")[0]
            client.teach_object(operation="teach", object=iri, class_description=kind)
