"""Products on the simulated table: sizes, masses, collision shapes, appearance.

A product is a kind, a size, a mass and a printed surface, all derived from its name: ``can-17`` is
the same on every robot's table. The *body frame* has its origin in the centre of mass, with z up in
the initial pose (a pen lies along x).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast

import numpy as np

from rtask.errors import UsageError
from simulate.world.hidden import (
    HIDDEN_KINDS,
    NO_SECRET,
    UNFORESEEN_KINDS,
    HiddenKind,
    Secret,
    draw_hidden,
)
from simulate.world.meshes import TexturedMesh, build_mesh, write_mesh
from simulate.world.textures import make_look

__all__ = [
    "KINDS",
    "PRODUCTS",
    "Assets",
    "Friction",
    "ObjectSpec",
    "Primitive",
    "collision_of",
    "inertia_of",
    "product",
    "sample_objects",
    "sample_products",
    "spec_of",
    "write_assets",
]

PlainKind = Literal["can", "ball", "box", "bottle", "pen"]
Kind = PlainKind | HiddenKind

KINDS: tuple[PlainKind, ...] = ("can", "ball", "box", "bottle", "pen")
"""The families, each graspable by a hand of about 5 cm usable opening."""

BOTTLE_BODY = 0.62
"""Share of a bottle's height below its shoulder; the shoulder ends at :data:`BOTTLE_SHOULDER`."""

BOTTLE_SHOULDER = 0.74
"""Share of a bottle's height below its neck."""

BOTTLE_NECK = 0.44
"""Diameter of a bottle's neck as a share of its body's."""

_SIZES: dict[str, tuple[tuple[float, float], ...]] = {
    "can": ((0.024, 0.040), (0.06, 0.09)),  # diameter, height
    "ball": ((0.030, 0.040),),  # diameter
    "box": ((0.022, 0.034), (0.022, 0.050), (0.035, 0.060)),  # x, y, z
    "bottle": ((0.032, 0.042), (0.09, 0.12)),  # diameter of the body, height
    "pen": ((0.016, 0.022), (0.09, 0.13)),  # diameter, length
}
_MASSES = {
    "can": (0.015, 0.05),
    "ball": (0.005, 0.03),
    "box": (0.01, 0.05),
    "bottle": (0.02, 0.06),
    "pen": (0.008, 0.02),
}
PRODUCTS: dict[str, tuple[Kind, ...]] = {
    "plain": KINDS,
    "hard": ("carton", "bar", "carton", "flask", "carton", "box", "carton", "carton"),
    "light": ("carton", "rod"),
    "fragile": ("carton", "carton", "rod", "carton"),
    "unforeseen": UNFORESEEN_KINDS,
}
"""Sets of products: each a sequence of kinds that repeats. Of the hard ones, all but the box hide
what decides a grasp; so do all the light and the fragile ones, which a hand of 2 to 3 N can lift.
Rods are mostly held at once, cartons mostly not: hence three cartons of four are fragile."""

_CATALOGUE = 200  # numbers that sample_objects draws from, per kind


@dataclass(frozen=True)
class Friction:
    """Contact parameters of a body, as Bullet takes them.

    Parameters
    ----------
    lateral
        Coulomb coefficient; Bullet multiplies those of the two bodies.
    spinning, rolling
        Torsional and rolling coefficients, m.
    linear_damping, angular_damping
        Share of the velocity lost per second.
    """

    lateral: float = 0.8
    spinning: float = 0.0008
    rolling: float = 0.00005
    linear_damping: float = 0.02
    angular_damping: float = 0.05


@dataclass(frozen=True)
class Primitive:
    """One convex collision shape.

    Parameters
    ----------
    shape
        ``"box"``, ``"cylinder"`` (axis along its own z) or ``"sphere"``.
    size
        Box: edge lengths x, y, z; cylinder: radius, length; sphere: radius. m.
    position : (3,) m, orientation : (4,) quaternion x, y, z, w
        ``body_from_shape``.
    """

    shape: Literal["box", "cylinder", "sphere"]
    size: tuple[float, ...]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @property
    def volume(self) -> float:
        """Volume in m3."""
        if self.shape == "box":
            return math.prod(self.size)
        if self.shape == "cylinder":
            return math.pi * self.size[0] ** 2 * self.size[1]
        return 4 / 3 * math.pi * self.size[0] ** 3


@dataclass(frozen=True)
class ObjectSpec:
    """A product.

    Parameters
    ----------
    kind
        One of :data:`KINDS` or of :data:`simulate.world.hidden.HIDDEN_KINDS`.
    dims
        can, bottle: diameter, height; ball: diameter; pen: diameter, length; others: x, y, z. m.
    mass
        kg.
    texture_seed
        Of the printed look.
    name
        The product: same name, same kind, size, mass and look.
    friction
        Contact parameters.
    secret
        Properties that cannot be seen.
    """

    kind: Kind
    dims: tuple[float, ...]
    mass: float
    texture_seed: int
    name: str
    friction: Friction = Friction()
    secret: Secret = NO_SECRET

    def __post_init__(self) -> None:
        if self.shape not in _SIZES:
            raise UsageError(_unknown(self.kind))
        if len(self.dims) != len(_SIZES[self.shape]) or not all(d > 0 for d in self.dims):
            raise UsageError(
                f"a {self.kind} takes {len(_SIZES[self.shape])} positive sizes in m, "
                f"got {self.dims}"
            )

    def scaled(self, factor: float) -> ObjectSpec:
        """Return a product of the same shape and density, scaled by a factor."""
        dims = tuple(round(size * factor, 4) for size in self.dims)
        name = f"{self.name}-x{factor:g}"
        return replace(self, dims=dims, mass=round(self.mass * factor**3, 4), name=name)

    @property
    def shape(self) -> str:
        """Visible shape: one of :data:`KINDS`."""
        return "box" if self.kind in HIDDEN_KINDS else self.kind

    @property
    def is_round(self) -> bool:
        """Whether it can roll."""
        return self.shape != "box"

    @property
    def extent(self) -> tuple[float, float, float]:
        """Size along x, y, z of the body frame as it rests, m."""
        if self.kind == "ball":
            return (self.dims[0], self.dims[0], self.dims[0])
        if self.shape == "box":
            return (self.dims[0], self.dims[1], self.dims[2])
        diameter, length = self.dims
        if self.kind == "pen":
            return (length, diameter, diameter)
        return (diameter, diameter, length)

    @property
    def rest_height(self) -> float:
        """Height of the body frame's origin (centre of mass) above the support, m."""
        return _mass_height(self)

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle about the origin that covers it from above, m."""
        return (
            0.5 * math.hypot(self.extent[0], self.extent[1])
            if self.shape == "box"
            else (0.5 * max(self.extent[0], self.extent[1]))
        )


@dataclass(frozen=True)
class Assets:
    """Files and physics of a product, ready for a physics engine.

    Parameters
    ----------
    obj_path, texture_path
        Textured mesh in the body frame, m, and its print.
    collision
        Convex shapes in the body frame.
    inertia
        Principal moments about the centre of mass, along the body axes, kg m2.
    """

    obj_path: Path
    texture_path: Path
    collision: tuple[Primitive, ...]
    inertia: tuple[float, float, float]


def product(kind: Kind, number: int) -> ObjectSpec:
    """Return product ``number`` of a kind; the same number gives the same product everywhere.

    Examples
    --------
    >>> product("can", 17).name, product("can", 17) == product("can", 17)
    ('can-17', True)
    """
    every: tuple[str, ...] = (*KINDS, *HIDDEN_KINDS)
    if kind not in every:
        raise UsageError(_unknown(kind))
    if number < 0:
        raise UsageError(f"products are numbered from 0, got {number}")
    seed = every.index(kind) * 1_000_000 + number
    rng = np.random.default_rng([0x0B7EC7, seed])
    if kind in HIDDEN_KINDS:
        size, weight, secret = draw_hidden(kind, rng)
        return ObjectSpec(kind, size, weight, seed, f"{kind}-{number}", secret=secret)
    dims = tuple(round(float(rng.uniform(low, high)), 4) for low, high in _SIZES[kind])
    mass = round(float(rng.uniform(*_MASSES[kind])), 4)
    rolling = 0.00005 if kind == "box" else 0.0004
    return ObjectSpec(kind, dims, mass, seed, f"{kind}-{number}", Friction(rolling=rolling))


def spec_of(name: str, look_alike: bool = False) -> ObjectSpec:
    """Return the product of a name, or one that looks the same and has its secret the other way.

    >>> spec_of("can-17").kind
    'can'
    >>> bar, other = spec_of("bar-3"), spec_of("bar-3", look_alike=True)
    >>> bar.texture_seed == other.texture_seed, bar.secret == other.secret
    (True, False)
    """
    kind, _, number = name.partition("-")
    spec = product(cast(Kind, kind), int(number))
    return replace(spec, secret=spec.secret.mirrored()) if look_alike else spec


def _unknown(kind: str) -> str:
    return f"unknown kind of object {kind!r}; kinds are {', '.join((*KINDS, *HIDDEN_KINDS))}"


def sample_objects(
    rng: np.random.Generator, n: int, kinds: tuple[Kind, ...] | None = None
) -> list[ObjectSpec]:
    """Draw ``n`` different products with the kinds as evenly mixed as they can be.

    Parameters
    ----------
    rng
        Source of every choice: the same generator state gives the same list.
    n
        Number of products.
    kinds
        Families to draw from, default all of :data:`KINDS`.

    Returns
    -------
    list of ObjectSpec
        In random order; every kind appears ``n // len(kinds)`` times or once more.
    """
    kinds = KINDS if kinds is None else tuple(kinds)
    if n < 0 or not kinds or n > _CATALOGUE * len(kinds):
        raise UsageError(f"cannot draw {n} different products of kinds {kinds}")
    order = [kinds[int(k)] for k in rng.permutation(len(kinds))]
    chosen = [order[i % len(order)] for i in range(n)]
    numbers = {kind: rng.permutation(_CATALOGUE) for kind in order}
    specs = [product(kind, int(numbers[kind][i])) for i, kind in enumerate(chosen)]
    return [specs[int(k)] for k in rng.permutation(n)]


def sample_products(products: str, rng: np.random.Generator, n: int) -> list[ObjectSpec]:
    """Draw ``n`` different products of a set of :data:`PRODUCTS`.

    Raises
    ------
    UsageError
        There is no such set.
    """
    if products not in PRODUCTS:
        raise UsageError(f"unknown products {products!r}: expected one of {', '.join(PRODUCTS)}")
    if products == "plain":
        return sample_objects(rng, n)
    kinds = [PRODUCTS[products][i % len(PRODUCTS[products])] for i in range(n)]
    numbers = {kind: rng.permutation(_CATALOGUE) for kind in dict.fromkeys(PRODUCTS[products])}
    specs = [product(kind, int(numbers[kind][i])) for i, kind in enumerate(kinds)]
    return [specs[int(k)] for k in rng.permutation(n)]


def write_assets(spec: ObjectSpec, folder: Path) -> Assets:
    """Write mesh, material and print of a product and return them with its physics.

    Files that are there already are kept: a product never changes. Several processes may write
    into one folder at once.

    Parameters
    ----------
    spec
        The product.
    folder
        Receives ``<name>.obj``, ``<name>.mtl`` and ``<name>.png``; made when missing.
    """
    folder = Path(folder)
    obj_path, texture_path = folder / f"{spec.name}.obj", folder / f"{spec.name}.png"
    if not obj_path.exists():
        write_mesh(_mesh_of(spec), folder, spec.name)
    shapes = collision_of(spec)
    return Assets(obj_path, texture_path, shapes, inertia_of(shapes, spec.mass))


def _mesh_of(spec: ObjectSpec) -> TexturedMesh:
    profile = None
    if spec.kind == "bottle":
        radius, height, low = 0.5 * spec.dims[0], spec.dims[1], -_mass_height(spec)
        neck = BOTTLE_NECK * radius
        profile = [
            (radius, low),
            (radius, low + BOTTLE_BODY * height),
            (neck, low + BOTTLE_SHOULDER * height),
            (neck, low + height),
        ]
    elif spec.kind in ("can", "pen"):
        radius, half = 0.5 * spec.dims[0], 0.5 * spec.dims[1]
        profile = [(radius, -half), (radius, half)]
    return build_mesh(spec.shape, spec.extent, profile, make_look(spec.texture_seed))


def _bottle_parts(spec: ObjectSpec) -> list[tuple[float, float, float]]:
    """Return (radius, length, height of the centre above the support) of body, shoulder, neck."""
    radius, height = 0.5 * spec.dims[0], spec.dims[1]
    neck = BOTTLE_NECK * radius
    edges = (0.0, BOTTLE_BODY * height, BOTTLE_SHOULDER * height, height)
    radii = (radius, 0.5 * (radius + neck), neck)
    return [
        (r, high - low, 0.5 * (low + high))
        for r, low, high in zip(radii, edges[:-1], edges[1:], strict=True)
    ]


def _mass_height(spec: ObjectSpec) -> float:
    if spec.kind != "bottle":
        return 0.5 * spec.extent[2]
    parts = _bottle_parts(spec)
    weights = [radius**2 * length for radius, length, _ in parts]
    moments = [w * centre for w, (_, _, centre) in zip(weights, parts, strict=True)]
    return sum(moments) / sum(weights)


def collision_of(spec: ObjectSpec) -> tuple[Primitive, ...]:
    """Return the convex shapes of a product in its body frame."""
    if spec.shape == "box":
        return (Primitive("box", spec.extent),)
    if spec.kind == "ball":
        return (Primitive("sphere", (0.5 * spec.dims[0],)),)
    if spec.kind == "bottle":
        low = _mass_height(spec)
        return tuple(
            Primitive("cylinder", (radius, length), (0.0, 0.0, centre - low))
            for radius, length, centre in _bottle_parts(spec)
        )
    quarter = math.sqrt(0.5)  # a pen lies: the cylinder's z turned onto x
    orientation = (0.0, quarter, 0.0, quarter) if spec.kind == "pen" else (0.0, 0.0, 0.0, 1.0)
    return (Primitive("cylinder", (0.5 * spec.dims[0], spec.dims[1]), orientation=orientation),)


def inertia_of(shapes: tuple[Primitive, ...], mass: float) -> tuple[float, float, float]:
    """Sum the shapes' solid inertia about the origin, mass shared by volume."""
    total = sum(shape.volume for shape in shapes)
    moments = np.zeros(3)
    for shape in shapes:
        m = mass * shape.volume / total
        if shape.shape == "box":
            squares = np.square(shape.size)
            own = m / 12 * (squares.sum() - squares)
        elif shape.shape == "sphere":
            own = np.full(3, 0.4 * m * shape.size[0] ** 2)
        else:
            radius, length = shape.size
            across, axial = m / 12 * (3 * radius**2 + length**2), 0.5 * m * radius**2
            lies_along_x = abs(shape.orientation[1]) > 0.5
            own = np.array([axial, across, across] if lies_along_x else [across, across, axial])
        offset = np.square(shape.position)
        moments += own + m * (offset.sum() - offset)
    return float(moments[0]), float(moments[1]), float(moments[2])
