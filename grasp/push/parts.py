"""Example parts, drawn for this project.

The outlines of the thesis (Kehoe 2014, Fig. 3.8 and 3.12) were traced from images and are not
published. These **stand-ins** imitate what its text says of each part; results on them can be
compared with the published ones in kind, not digit by digit. Counter-clockwise, arbitrary units.
"""

from __future__ import annotations

import numpy as np

from grasp.arrays import FloatArray

__all__ = [
    "BRACKETS",
    "OBJECT_M",
    "SHAPES",
    "TAPE_DISPENSER",
    "TAPE_DISPENSER_COM",
    "TOLERANCING",
    "stand_in",
]

_TEXT = {
    "A": "0,0 4,0 4,1 3,1.2 3,2 4,2.2 4,3 1,3 .6,2.4 .6,1.8 0,1.5 -.2,.7",
    "B": "0,0 3,.6 3.4,1.4 2.6,1.8 1.8,3.2 .9,3.4 .4,2.4 -.4,.8",
    "C": "0,0 4,0 4,.8 2.6,.8 2.6,1.6 4,1.6 4,2.4 0,2.4 -.5,1.2",
    "D": "0,0 5,0 5,.9 4.2,1.1 4.2,1.3 0,1.3",
    "E": "0,0 2,0 2.4,.6 2,2 .4,2.2 -.3,1",
    "F": "0,0 3,0 3,1 1.9,1.6 1.7,2.2 1.2,2.2 1,1.6 0,1",
    "G": "-4,-.2 -3.9,-.35 -.5,-.8 -.4,-.3 .4,-.3 .5,-.8 3.9,-.35 4,-.2 "
    "4,.2 3.9,.35 .5,.8 .4,.3 -.4,.3 -.5,.8 -3.9,.35 -4,.2",
    "H": "0,0 3,0 3.1,1.2 2.3,1.5 2,2.4 1.5,2.1 1.1,2.5 .8,1.5 -.1,1.2",
    "I": "0,0 3,0 3,2 2.2,2 2.2,1.4 .8,1.4 .8,2 0,2",
    "J": "0,0 4,0 4.8,.7 4.2,1.2 -.2,1.2 -.8,.5",
    "K": "0,0 .6,0 .6,2.4 1.8,2.4 1.8,0 2.4,0 2.4,3 0,3",
    "L": "0,0 3,0 3,.6 .8,2.2 0,2.2",
    "M": "-26,-4 -12,-5.5 -6,-13 12,-13 12,-3.5 28,-3.5 28,3.5 12,3.5 12,13 -6,13 -12,5.5 -26,4",
    "rectangle": "0,0 2,0 2,1 0,1",
    "ell": "0,0 3,0 3,1 1,1 1,3 0,3",
    "tee": "0,0 1,0 1,2 2,2 2,3 -1,3 -1,2 0,2",
    "TA": "0,0 2,0 2,1 0,1",
    "TB": "0,0 2,0 2,.8 1,1.3 0,.8",
    "TC": "0,0 2,0 2,.9 1.5,1.2 1,.9 .5,1.2 0,.9",
    "TD": "0,0 4,0 4,.6 0,.6",
    "tape": "0,0 5.2,0 5.6,.5 5.3,.9 3.9,1 3.4,1.9 2.6,2.5 1.6,2.5 .8,2 .3,1.2",
}

BRACKETS = tuple("ABCDEFGHIJKL")
"""Stand-ins of the twelve parts of Fig. 3.8."""

SHAPES = ("rectangle", "ell", "tee")

TOLERANCING = ("TA", "TB", "TC", "TD")
"""Stand-ins of the four parts of Fig. 3.12: flat, one vertex, three vertices, thin; the edge that
is tested lies on y = 0."""

TAPE_DISPENSER_COM = (2.444, 0.985)

OBJECT_M = "M"
"""Stand-in of the electrical plug of Fig. 3.20, from the side, prong to the right, in mm."""


def stand_in(name: str) -> FloatArray:
    """Return the outline (n, 2) of a stand-in.

    >>> stand_in("D").shape
    (6, 2)
    """
    try:
        text = _TEXT[name]
    except KeyError:
        raise ValueError(f"no stand-in {name!r}; there are {', '.join(_TEXT)}") from None
    return np.array([[float(v) for v in pair.split(",")] for pair in text.split()])


TAPE_DISPENSER: FloatArray = stand_in("tape")
"""Stand-in of the part of Fig. 3.22."""
