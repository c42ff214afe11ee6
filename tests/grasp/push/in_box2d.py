"""The same simulation in Box2D, as a cross-check (Kehoe 2014, 3.8 used Box2D).

Box2D is a dynamic engine. Quasi-static motion comes from setting the part's velocity to zero before
every step, so that a step moves it by what the contacts alone ask for, and from the ratio of its
moment of inertia to its mass, which stands for c^2 of the limit surface.

Parts are scaled up and positions corrected once a step: Box2D's skin and slop (.01 and .005) have
fixed sizes, and its corrections move bodies out of one another without friction, so that a jam on
inclined edges would slip open.

Only this file imports Box2D, which is optional: ``pip install box2d``.
"""

from __future__ import annotations

import importlib
import math
import warnings
from typing import Any

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.mechanics.contact import NOTHING, highest, lowest
from grasp.push.mechanics.quasistatic import CLOSED, LOST, NOT_HELD
from grasp.push.polygon import triangles

__all__ = ["is_available", "simulate_in_box2d"]

_SIZE = 30.0
_VELOCITY_ROUNDS, _POSITION_ROUNDS = 20, 1
_STEP_S = 1.0 / 60.0
_STILL, _JAMMED, _FREE = 8, 40, 60
_EDGE = 0.02


def _box2d() -> Any:
    with warnings.catch_warnings():
        # The wrapper's types lack __module__; as an error that warning ends the interpreter.
        warnings.simplefilter("ignore")
        return importlib.import_module("Box2D")


def is_available() -> bool:
    """Return whether Box2D can be imported."""
    try:
        _box2d()
    except ImportError:
        return False
    return True


def simulate_in_box2d(
    ring: FloatArray,
    com: FloatArray,
    grasp: FloatArray,
    width: float,
    friction: float,
    c2: float,
    diameter: float,
    step: float,
) -> int:
    """Return CLOSED, NOT_HELD or LOST for one grasp on one part.

    Parameters
    ----------
    ring : (n, 2), com : (2,), grasp : (5,)
        As for the own solver; lengths in one unit.
    """
    scale = _SIZE / diameter
    dx, dy = float(grasp[2]), float(grasp[3])
    turn = np.array([[dy, dx], [-dx, dy]])
    local = np.ascontiguousarray((ring - grasp[:2]) @ turn * scale)
    mass = (com - grasp[:2]) @ turn * scale
    w, h = width * scale, step * scale
    lo = 0.0 if grasp[4] > 0 else -w
    x, y = local[:, 0].copy(), local[:, 1].copy()
    kind, _, _, face = lowest(x, y, len(x), lo, lo + w)
    if kind == NOTHING:
        return LOST
    world = _World(local, mass, friction, c2 * scale * scale, lo, w)
    return world.run(face, h, 3.0 * diameter * scale)


class _World:
    """Part and jaws in Box2D's units, x along the jaws' faces."""

    def __init__(
        self, local: FloatArray, mass: FloatArray, friction: float, c2: float, lo: float, w: float
    ) -> None:
        self.b2 = _box2d()
        self.local, self.friction, self.lo, self.w = local - mass, friction, lo, w
        self.lever = math.sqrt(c2)
        self.world = self.b2.b2World(gravity=(0, 0), doSleep=False)
        self.world.warmStarting = False
        self.world.continuousPhysics = False
        self.part = self.world.CreateDynamicBody(position=tuple(map(float, mass)))
        for triangle in triangles(self.local):
            if abs(float(np.linalg.det(triangle[1:] - triangle[0]))) < 1e-4:
                continue  # Box2D refuses slivers
            vertices = [(float(p), float(q)) for p, q in triangle]
            self.part.CreatePolygonFixture(vertices=vertices, density=1, friction=friction)
        self.part.massData = self.b2.b2MassData(mass=1.0, center=(0.0, 0.0), I=c2)

    def _jaw(self, face: float, up: float) -> Any:
        thick = 0.2 * self.w
        middle = (self.lo + self.w / 2, face - up * thick / 2)
        body = self.world.CreateKinematicBody(position=middle)
        body.CreatePolygonFixture(box=(self.w / 2, thick / 2), friction=self.friction)
        return body

    def _outline(self) -> tuple[FloatArray, FloatArray]:
        c, s = math.cos(self.part.angle), math.sin(self.part.angle)
        x = c * self.local[:, 0] - s * self.local[:, 1] + self.part.position[0]
        y = s * self.local[:, 0] + c * self.local[:, 1] + self.part.position[1]
        return np.ascontiguousarray(x), np.ascontiguousarray(y)

    def _step(self) -> None:
        self.part.linearVelocity = (0.0, 0.0)
        self.part.angularVelocity = 0.0
        self.world.Step(_STEP_S, _VELOCITY_ROUNDS, _POSITION_ROUNDS)

    def run(self, face: float, h: float, most: float) -> int:
        """Push until nothing moves, close, and test."""
        first = self._jaw(face - 0.02, 1.0)
        first.linearVelocity = (0.0, h / _STEP_S)
        still, travel, missed = 0, 0.0, 0
        while still < _STILL and travel < most:
            before = (self.part.position[0], self.part.angle)
            self._step()
            travel += h
            missed = 0 if self._contacts(first) else missed + 1
            if travel > 4 * h + 0.05 and missed > 4:
                return LOST
            turned = abs(self.part.angle - before[1]) * self.lever
            moved = abs(self.part.position[0] - before[0]) + turned
            still = still + 1 if moved < 2e-3 * h and not missed else 0
        first.linearVelocity = (0.0, 0.0)
        x, y = self._outline()
        kind, _, _, top = highest(x, y, len(x), self.lo, self.lo + self.w)
        if kind == NOTHING:
            return LOST
        second = self._jaw(top + 0.02, -1.0)
        second.linearVelocity = (0.0, -h / _STEP_S)
        return self._close(first, second, h)

    def _close(self, first: Any, second: Any, h: float) -> int:
        thick, jammed, free = 0.2 * self.w, 0, 0
        while True:
            self._step()
            low, high = first.position[1] + thick / 2, second.position[1] - thick / 2
            if high <= low + h:
                return NOT_HELD
            x, y = self._outline()
            below, above = self._contacts(first), self._contacts(second)
            if not below and not above:
                free += 1
                if free > _FREE or x.max() < self.lo or x.min() > self.lo + self.w:
                    return LOST
                continue
            if not below or not above:
                continue
            # What stands beside a jaw's end may lie within Box2D's slop of its window.
            window = (self.lo + _EDGE, self.lo + self.w - _EDGE)
            deepest = max(
                highest(x, y, len(x), *window)[3] - high, low - lowest(x, y, len(x), *window)[3]
            )
            if deepest > 3 * h:
                jammed += 1
                if self._held(below, above):
                    return CLOSED
                if jammed > _JAMMED:
                    return NOT_HELD

    def _contacts(self, jaw: Any) -> list[tuple[float, float, float, float]]:
        """Return points and inward normals of the part's contacts with a jaw."""
        out = []
        for edge in self.part.contacts:
            contact = edge.contact
            if not contact.touching:
                continue
            a, b = contact.fixtureA.body, contact.fixtureB.body
            # Wrappers are made again at every look, so identity says nothing.
            if a != jaw and b != jaw:
                continue
            manifold = contact.worldManifold
            sign = 1.0 if a == jaw else -1.0
            nx, ny = sign * manifold.normal[0], sign * manifold.normal[1]
            for k in range(contact.manifold.pointCount):
                px, py = manifold.points[k]
                out.append((px, py, nx, ny))
        return out

    def _held(
        self,
        below: list[tuple[float, float, float, float]],
        above: list[tuple[float, float, float, float]],
    ) -> bool:
        cone = 1.0 / math.sqrt(1.0 + self.friction**2) - 1e-6
        for px, py, nx, ny in below:
            for qx, qy, mx, my in above:
                lx, ly = qx - px, qy - py
                length = math.hypot(lx, ly)
                if length < 1e-9:
                    continue
                first, second = (lx * nx + ly * ny) / length, -(lx * mx + ly * my) / length
                if first >= cone and second >= cone:
                    return True
        return False
