"""An operation that is not part of the product, and the command line with it in the table."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Le

from rtask.engine.context import Context
from rtask.engine.engine import Engine
from rtask.engine.operations.operation import operation
from rtask.kb.commit.access import Access
from rtask.wire.message import Answer, Message, named
from rtask.wire.types import Flag, Number, Text, Unit


class WeighObject(Message):
    """A wish to know what something weighs."""

    object: Text
    """name of the object"""
    volume: Annotated[Number, Unit("m3"), Ge(0), Le(1)]
    """of the material"""
    material: Literal["steel", "wood"] = "wood"
    """what it is made of"""
    hollow: Flag = True
    """whether there is air inside"""


class Weighed(Answer):
    """Answer with the weight of something."""

    class_: str = named("class")
    mass: float
    """kg"""


@operation("read", "reads", "tell what an object weighs")
def weigh_object(context: Context, request: WeighObject, access: Access) -> Weighed:
    """Multiply volume and density; the mass of what is cursed is not a number."""
    density = {"steel": 7850.0, "wood": 600.0}[request.material]
    mass = request.volume * density * (0.5 if request.hollow else 1.0)
    return Weighed(class_="thing", mass=float("nan") if request.object == "cursed" else mass)


OPERATIONS = {**Engine.operations, weigh_object.name: weigh_object}

if __name__ == "__main__":
    from rtask.cli import main

    Engine.operations = OPERATIONS
    main()
