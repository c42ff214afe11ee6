"""Data of the Berlin SPARQL Benchmark: a shop's products, offers and reviews.

Bizer and Schultz 2009, "The Berlin SPARQL Benchmark", and its dataset specification of 2010: the
published schema, shares and distributions, with a random stream and words of our own. Two things
differ from the original generator, so that every engine has one right answer: labels end with the
number of what they name, because several queries order by label and stop after ten rows; and
products carry all their types (its option ``-fc``), because not every engine derives them.
"""

from __future__ import annotations

import datetime
import itertools
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field

INSTANCES = "http://www4.wiwiss.fu-berlin.de/bizer/bsbm/v01/instances/"
VOCABULARY = "http://www4.wiwiss.fu-berlin.de/bizer/bsbm/v01/vocabulary/"
COUNTRIES = "http://downlode.org/rdf/iso-3166/countries#"
TODAY = datetime.datetime(2008, 6, 20)

_XSD = "http://www.w3.org/2001/XMLSchema#"
_PREFIXES = {
    "bsbm": VOCABULARY,
    "dc": "http://purl.org/dc/elements/1.1/",
    "foaf": "http://xmlns.com/foaf/0.1/",
    "rdf": "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "rev": "http://purl.org/stuff/rev#",
}
_SHARES = {
    "US": 40,
    "GB": 10,
    "JP": 10,
    "CN": 10,
    "DE": 5,
    "FR": 5,
    "ES": 5,
    "RU": 5,
    "KR": 5,
    "AT": 5,
}
_LANGUAGES = {
    "JP": "ja",
    "CN": "zh",
    "DE": "de",
    "FR": "fr",
    "ES": "es",
    "RU": "ru",
    "KR": "ko",
    "AT": "de",
}
_PRODUCTS_OF_PRODUCER = 50
_OFFERS_OF_PRODUCT, _OFFERS_OF_VENDOR = 20, 2_000
_REVIEWS_OF_PRODUCT, _REVIEWS_OF_PERSON, _REVIEWS_OF_SITE = 10, 20, 10_000
_WORDS = 5_000


@dataclass
class ProductType:
    """A class of products with the features that its products may have.

    Attributes
    ----------
    iri : str
    above : ProductType, optional
        None for the root.
    depth : int
        0 for the root.
    features : list of str
        IRIs of its own features, without those of the types above.
    """

    iri: str
    above: ProductType | None = None
    depth: int = 0
    features: list[str] = field(default_factory=list)

    def lineage(self) -> Iterator[ProductType]:
        """Yield this type and those above it, without the root."""
        if self.above is not None:
            yield self
            yield from self.above.lineage()

    def all_features(self) -> list[str]:
        """Return its features and those of the types above it."""
        return [feature for kind in self.lineage() for feature in kind.features]


class Shop:
    """Draws a shop; its lists are complete once :meth:`lines` is exhausted.

    Parameters
    ----------
    products
        Number of products; each brings about 360 statements.
    seed
        Of the random stream.

    Attributes
    ----------
    types : list of ProductType
        Breadth first, so that the leaves are at the end.
    products, offers, reviews : list of str
        IRIs.
    """

    def __init__(self, products: int, seed: int = 0) -> None:
        self._count = products
        self._random = random.Random(seed)
        syllables = ["".join(pair) for pair in itertools.product("bdfgklmnprstvz", "aeiou")]
        self._words = [
            "".join(self._random.choices(syllables, k=self._random.randint(2, 4)))
            for _ in range(_WORDS)
        ]
        self.types: list[ProductType] = []
        self.products: list[str] = []
        self.offers: list[str] = []
        self.reviews: list[str] = []
        self._producers: list[str] = []

    def lines(self) -> Iterator[str]:
        """Yield the statements in N-Triples, a line each."""
        yield from self._draw_types()
        yield from self._draw_features()
        yield from self._draw_products()
        yield from self._draw_offers()
        yield from self._draw_reviews()

    def leaves(self) -> list[ProductType]:
        """Return the most special types."""
        deepest = self.types[-1].depth
        return [kind for kind in self.types if kind.depth == deepest]

    def _draw_types(self) -> Iterator[str]:
        log = math.log10(max(self._count, 10))
        depth = round(log / 2) + 1
        branches = [2 * round(log), *[8] * (depth - 2), (2, 4, 8)[round(1.5 * log + 1) % 3]]
        level = [ProductType(INSTANCES + "ProductType1")]
        self.types = list(level)
        for number in branches[:depth]:
            below = []
            for above in level:
                for _ in range(number):
                    iri = f"{INSTANCES}ProductType{len(self.types) + len(below) + 1}"
                    below.append(ProductType(iri, above, above.depth + 1))
            self.types += below
            level = below
        for number, kind in enumerate(self.types, 1):
            yield _link(kind.iri, "rdf:type", VOCABULARY + "ProductType")
            yield from self._described(kind.iri, number)
            if kind.above is not None:
                yield _link(kind.iri, "rdfs:subClassOf", kind.above.iri)
            yield from self._published(kind.iri, INSTANCES + "StandardizationInstitution1")

    def _draw_features(self) -> Iterator[str]:
        depth = self.types[-1].depth
        total = depth * (depth + 1) // 2 - 1
        number = 0
        for kind in self.types[1:]:
            low, high = (
                (5, 5) if kind.depth == 1 else (35 * kind.depth // total, 75 * kind.depth // total)
            )
            for _ in range(self._random.randint(low, high)):
                number += 1
                feature = f"{INSTANCES}ProductFeature{number}"
                kind.features.append(feature)
                yield _link(feature, "rdf:type", VOCABULARY + "ProductFeature")
                yield from self._described(feature, number)
                yield from self._published(feature, INSTANCES + "StandardizationInstitution1")

    def _draw_products(self) -> Iterator[str]:
        left, producer_number = 0, 0
        leaves = self.leaves()
        producer = home = ""
        for number in range(1, self._count + 1):
            if not left:
                left, producer_number = self._around(_PRODUCTS_OF_PRODUCER), producer_number + 1
                home = f"{INSTANCES}dataFromProducer{producer_number}/"
                producer = f"{home}Producer{producer_number}"
                yield from self._company(producer, "Producer", producer_number)
            left -= 1
            product = f"{home}Product{number}"
            self.products.append(product)
            self._producers.append(producer)
            kind = leaves[self._within(len(leaves), 0.0, 0.5) - 1]
            yield from self._product(product, number, producer, kind)

    def _product(
        self, product: str, number: int, producer: str, kind: ProductType
    ) -> Iterator[str]:
        yield _link(product, "rdf:type", VOCABULARY + "Product")
        for one in kind.lineage():
            yield _link(product, "rdf:type", one.iri)
        yield _link(product, "rdf:type", self.types[0].iri)
        yield from self._described(product, number, 50, 150)
        yield _link(product, "bsbm:producer", producer)
        for feature in kind.all_features():
            if self._random.random() < 0.25:
                yield _link(product, "bsbm:productFeature", feature)
        # All products have properties 1 to 3; of ten, four have 4 and 5 as well, two some of these,
        # and four some of 5 and 6.
        fourth, fifth, sixth = self._random.choices(
            ((1.0, 1.0, 0.0), (0.5, 0.25, 0.0), (0.0, 0.25, 0.5)), (40, 20, 40)
        )[0]
        for at, chance in enumerate((1.0, 1.0, 1.0, fourth, fifth, sixth), 1):
            if self._random.random() < chance:
                value = self._within(2_000, 0.0, 0.5)
                yield _value(product, f"bsbm:productPropertyNumeric{at}", value, _XSD + "integer")
            if self._random.random() < chance:
                yield _text(product, f"bsbm:productPropertyTextual{at}", self._sentence(3, 15))
        yield from self._published(product, producer)

    def _draw_offers(self) -> Iterator[str]:
        left, vendor_number = 0, 0
        vendor = home = ""
        for number in range(1, self._count * _OFFERS_OF_PRODUCT + 1):
            if not left:
                left, vendor_number = self._around(_OFFERS_OF_VENDOR), vendor_number + 1
                home = f"{INSTANCES}dataFromVendor{vendor_number}/"
                vendor = f"{home}Vendor{vendor_number}"
                yield from self._company(vendor, "Vendor", vendor_number)
            left -= 1
            offer = f"{home}Offer{number}"
            self.offers.append(offer)
            product = self.products[self._within(self._count, 0.5, 0.25) - 1]
            price = f"{self._random.uniform(5, 10_000):.2f}"
            published = TODAY - datetime.timedelta(days=self._random.randrange(97))
            since = published - datetime.timedelta(days=self._random.randint(0, 90))
            until = published + datetime.timedelta(days=self._random.randint(7, 90))
            yield _link(offer, "rdf:type", VOCABULARY + "Offer")
            yield _link(offer, "bsbm:product", product)
            yield _link(offer, "bsbm:vendor", vendor)
            yield _value(offer, "bsbm:price", price, VOCABULARY + "USD")
            yield _value(offer, "bsbm:validFrom", since.isoformat(), _XSD + "dateTime")
            yield _value(offer, "bsbm:validTo", until.isoformat(), _XSD + "dateTime")
            days = self._within(21, 0.1, 0.2)
            yield _value(offer, "bsbm:deliveryDays", days, _XSD + "integer")
            yield _link(
                offer, "bsbm:offerWebpage", f"http://www.vendor{vendor_number}.com/Offer{number}/"
            )
            yield _link(offer, "dc:publisher", vendor)
            yield _value(offer, "dc:date", published.date().isoformat(), _XSD + "date")

    def _draw_reviews(self) -> Iterator[str]:
        left, person_number = 0, 0
        person = country = home = ""
        for number in range(1, self._count * _REVIEWS_OF_PRODUCT + 1):
            site_number = (number - 1) // _REVIEWS_OF_SITE + 1
            site = f"{INSTANCES}dataFromRatingSite{site_number}/"
            if not left or site != home:
                left, person_number, home = (
                    self._around(_REVIEWS_OF_PERSON),
                    person_number + 1,
                    site,
                )
                person, country = f"{home}Reviewer{person_number}", self._country()
                yield _link(person, "rdf:type", _PREFIXES["foaf"] + "Person")
                yield _text(person, "foaf:name", f"{self._sentence(1, 1)} {person_number}")
                yield _text(person, "foaf:mbox_sha1sum", f"{self._random.getrandbits(160):040x}")
                yield _link(person, "bsbm:country", COUNTRIES + country)
                yield from self._published(person, f"{home}RatingSite{site_number}")
            left -= 1
            review = f"{home}Review{number}"
            self.reviews.append(review)
            at = self._within(self._count, 0.5, 0.25) - 1
            when = TODAY - datetime.timedelta(seconds=self._random.randrange(365 * 86_400))
            language = _LANGUAGES.get(country, "en")
            yield _link(review, "rdf:type", _PREFIXES["rev"] + "Review")
            yield _link(review, "bsbm:reviewFor", self.products[at])
            yield _link(review, "rev:reviewer", person)
            yield _value(review, "bsbm:reviewDate", when.isoformat(), _XSD + "dateTime")
            yield _text(review, "dc:title", self._sentence(4, 15))
            yield _text(review, "rev:text", self._sentence(50, 200), language)
            for rating in range(1, 5):
                if self._random.random() < 0.7:
                    stars = self._random.randint(1, 10)
                    yield _value(review, f"bsbm:rating{rating}", stars, _XSD + "integer")
            yield from self._published(review, f"{home}RatingSite{site_number}")

    def _company(self, iri: str, kind: str, number: int) -> Iterator[str]:
        yield _link(iri, "rdf:type", VOCABULARY + kind)
        yield from self._described(iri, number)
        yield _link(iri, "foaf:homepage", f"http://www.{kind}{number}.com/".lower())
        yield _link(iri, "bsbm:country", COUNTRIES + self._country())
        yield from self._published(iri, iri)

    def _described(self, iri: str, number: int, low: int = 20, high: int = 50) -> Iterator[str]:
        yield _text(iri, "rdfs:label", f"{self._sentence(1, 3)} {number}")
        yield _text(iri, "rdfs:comment", self._sentence(low, high))

    def _published(self, iri: str, publisher: str) -> Iterator[str]:
        when = TODAY.date() - datetime.timedelta(days=self._random.randrange(2_000))
        yield _link(iri, "dc:publisher", publisher)
        yield _value(iri, "dc:date", when.isoformat(), _XSD + "date")

    def _sentence(self, low: int, high: int) -> str:
        return " ".join(self._random.choices(self._words, k=self._random.randint(low, high)))

    def _country(self) -> str:
        return self._random.choices(list(_SHARES), list(_SHARES.values()))[0]

    def _around(self, mean: int) -> int:
        """Return a number of things whose mean is given, normally distributed, at least one."""
        return max(1, round(self._random.gauss(mean, mean / 3)))

    def _within(self, most: int, middle: float, spread: float) -> int:
        """Return a number from 1 to `most`; mean and deviation are shares of it.

        The normal distribution is folded at zero, so that small numbers are frequent with mean 0.
        """
        while True:
            drawn = self._random.gauss(middle, spread)
            value = math.ceil(abs(drawn) * most)
            if 1 <= value <= most:
                return value


def _expanded(name: str) -> str:
    prefix, _, local = name.partition(":")
    return _PREFIXES[prefix] + local


def _link(subject: str, predicate: str, value: str) -> str:
    return f"<{subject}> <{_expanded(predicate)}> <{value}> .\n"


def _value(subject: str, predicate: str, value: object, datatype: str) -> str:
    return f'<{subject}> <{_expanded(predicate)}> "{value}"^^<{datatype}> .\n'


def _text(subject: str, predicate: str, value: str, language: str = "") -> str:
    return f'<{subject}> <{_expanded(predicate)}> "{value}"{language and "@" + language} .\n'
