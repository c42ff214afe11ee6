"""The explore mix of the Berlin SPARQL Benchmark: its queries, their order and how they are filled.

"BSBM explore use case", specification of 29 November 2010. A mix has 24 queries, in the published
order; query 6 was withdrawn there. Parameters are drawn as published: types of products at the
leaves (one level above for query 1), features that such products may have, numbers from 1 to 500.
"""

from __future__ import annotations

import random
import string
from collections.abc import Iterator
from dataclasses import dataclass

from tests.benchmarks.kb.bsbm import COUNTRIES, TODAY, VOCABULARY, ProductType, Shop

MIX = (1, 2, 2, 3, 2, 2, 4, 2, 2, 5, 7, 7, 7, 7, 8, 9, 9, 8, 9, 9, 10, 10, 11, 12)
"""Numbers of the queries of one mix, in their order."""

_PREFIXES = f"""PREFIX bsbm: <{VOCABULARY}>
PREFIX dc: <http://purl.org/dc/elements/1.1/>
PREFIX export: <http://www4.wiwiss.fu-berlin.de/bizer/bsbm/v01/vocabulary/export/>
PREFIX foaf: <http://xmlns.com/foaf/0.1/>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
PREFIX rev: <http://purl.org/stuff/rev#>
PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
"""
_NOW = f'"{TODAY.isoformat()}"^^xsd:dateTime'

QUERIES = {
    # Products of a type with two features.
    1: """SELECT DISTINCT ?product ?label {
  ?product rdfs:label ?label ; a <$type> ; bsbm:productFeature <$f1> , <$f2> ;
    bsbm:productPropertyNumeric1 ?value1 . FILTER (?value1 > $x)
} ORDER BY ?label LIMIT 10""",
    # Everything about one product.
    2: """SELECT ?label ?comment ?producer ?productFeature ?propertyTextual1 ?propertyTextual2
  ?propertyTextual3 ?propertyNumeric1 ?propertyNumeric2 ?propertyTextual4 ?propertyTextual5
  ?propertyNumeric4 {
  <$product> rdfs:label ?label ; rdfs:comment ?comment ; bsbm:producer ?p .
  ?p rdfs:label ?producer . <$product> dc:publisher ?p ; bsbm:productFeature ?f .
  ?f rdfs:label ?productFeature .
  <$product> bsbm:productPropertyTextual1 ?propertyTextual1 ;
    bsbm:productPropertyTextual2 ?propertyTextual2 ;
    bsbm:productPropertyTextual3 ?propertyTextual3 ;
    bsbm:productPropertyNumeric1 ?propertyNumeric1 ;
    bsbm:productPropertyNumeric2 ?propertyNumeric2 .
  OPTIONAL { <$product> bsbm:productPropertyTextual4 ?propertyTextual4 }
  OPTIONAL { <$product> bsbm:productPropertyTextual5 ?propertyTextual5 }
  OPTIONAL { <$product> bsbm:productPropertyNumeric4 ?propertyNumeric4 }
}""",
    # Products of a type with one feature and without another.
    3: """SELECT ?product ?label {
  ?product rdfs:label ?label ; a <$type> ; bsbm:productFeature <$f1> ;
    bsbm:productPropertyNumeric1 ?p1 . FILTER (?p1 > $x)
  ?product bsbm:productPropertyNumeric3 ?p3 . FILTER (?p3 < $y)
  OPTIONAL { ?product bsbm:productFeature <$f2> ; rdfs:label ?testVar }
  FILTER (!BOUND(?testVar))
} ORDER BY ?label LIMIT 10""",
    # Products that match either of two sets of features.
    4: """SELECT DISTINCT ?product ?label ?propertyTextual {
  { ?product rdfs:label ?label ; a <$type> ; bsbm:productFeature <$f1> , <$f2> ;
      bsbm:productPropertyTextual1 ?propertyTextual ; bsbm:productPropertyNumeric1 ?p1 .
    FILTER (?p1 > $x) }
  UNION
  { ?product rdfs:label ?label ; a <$type> ; bsbm:productFeature <$f1> , <$f3> ;
      bsbm:productPropertyTextual1 ?propertyTextual ; bsbm:productPropertyNumeric2 ?p2 .
    FILTER (?p2 > $y) }
} ORDER BY ?label OFFSET 5 LIMIT 10""",
    # Products similar to a given one.
    5: """SELECT DISTINCT ?product ?productLabel {
  ?product rdfs:label ?productLabel . FILTER (<$product> != ?product)
  <$product> bsbm:productFeature ?prodFeature . ?product bsbm:productFeature ?prodFeature .
  <$product> bsbm:productPropertyNumeric1 ?origProperty1 .
  ?product bsbm:productPropertyNumeric1 ?simProperty1 .
  FILTER (?simProperty1 < (?origProperty1 + 120) && ?simProperty1 > (?origProperty1 - 120))
  <$product> bsbm:productPropertyNumeric2 ?origProperty2 .
  ?product bsbm:productPropertyNumeric2 ?simProperty2 .
  FILTER (?simProperty2 < (?origProperty2 + 170) && ?simProperty2 > (?origProperty2 - 170))
} ORDER BY ?productLabel LIMIT 5""",
    # A product with its current offers from Germany and its reviews.
    7: """SELECT ?productLabel ?offer ?price ?vendor ?vendorTitle ?review ?revTitle ?reviewer
  ?revName ?rating1 ?rating2 {
  <$product> rdfs:label ?productLabel .
  OPTIONAL {
    ?offer bsbm:product <$product> ; bsbm:price ?price ; bsbm:vendor ?vendor .
    ?vendor rdfs:label ?vendorTitle ; bsbm:country <${countries}DE> .
    ?offer dc:publisher ?vendor ; bsbm:validTo ?date . FILTER (?date > $now) }
  OPTIONAL {
    ?review bsbm:reviewFor <$product> ; rev:reviewer ?reviewer .
    ?reviewer foaf:name ?revName . ?review dc:title ?revTitle .
    OPTIONAL { ?review bsbm:rating1 ?rating1 }
    OPTIONAL { ?review bsbm:rating2 ?rating2 } }
}""",
    # The latest English reviews of a product.
    8: """SELECT ?title ?text ?reviewDate ?reviewer ?reviewerName
  ?rating1 ?rating2 ?rating3 ?rating4 {
  ?review bsbm:reviewFor <$product> ; dc:title ?title ; rev:text ?text .
  FILTER (LANGMATCHES(LANG(?text), "EN"))
  ?review bsbm:reviewDate ?reviewDate ; rev:reviewer ?reviewer .
  ?reviewer foaf:name ?reviewerName .
  OPTIONAL { ?review bsbm:rating1 ?rating1 }
  OPTIONAL { ?review bsbm:rating2 ?rating2 }
  OPTIONAL { ?review bsbm:rating3 ?rating3 }
  OPTIONAL { ?review bsbm:rating4 ?rating4 }
} ORDER BY DESC(?reviewDate) LIMIT 20""",
    # Everything about the author of a review.
    9: "DESCRIBE ?x { <$review> rev:reviewer ?x }",
    # The cheapest offers of a product from the USA within three days.
    10: """SELECT DISTINCT ?offer ?price {
  ?offer bsbm:product <$product> ; bsbm:vendor ?vendor ; dc:publisher ?vendor .
  ?vendor bsbm:country <${countries}US> .
  ?offer bsbm:deliveryDays ?deliveryDays . FILTER (?deliveryDays <= 3)
  ?offer bsbm:price ?price ; bsbm:validTo ?date . FILTER (?date > $now)
} ORDER BY xsd:double(STR(?price)) LIMIT 10""",
    # Everything that is said about an offer.
    11: """SELECT ?property ?hasValue ?isValueOf {
  { <$offer> ?property ?hasValue } UNION { ?isValueOf ?property <$offer> }
}""",
    # An offer in another vocabulary.
    12: """CONSTRUCT {
  <$offer> export:product ?productURI ; export:productlabel ?productlabel ;
    export:vendor ?vendorname ; export:vendorhomepage ?vendorhomepage ; export:offerURL ?offerURL ;
    export:price ?price ; export:deliveryDays ?deliveryDays ; export:validuntil ?validTo .
} WHERE {
  <$offer> bsbm:product ?productURI . ?productURI rdfs:label ?productlabel .
  <$offer> bsbm:vendor ?vendorURI .
  ?vendorURI rdfs:label ?vendorname ; foaf:homepage ?vendorhomepage .
  <$offer> bsbm:offerWebpage ?offerURL ; bsbm:price ?price ; bsbm:deliveryDays ?deliveryDays ;
    bsbm:validTo ?validTo .
}""",
}


@dataclass(frozen=True)
class Question:
    """A query of a mix: its number in the specification and its text."""

    number: int
    text: str

    @property
    def is_graph(self) -> bool:
        """True if the answer consists of statements, not of rows."""
        return self.number in (9, 12)


def mixes(shop: Shop, seed: int = 1) -> Iterator[list[Question]]:
    """Yield one mix after the other, each with parameters of its own.

    Parameters
    ----------
    shop
        With its lists complete.
    seed
        Of the random stream.
    """
    drawn = random.Random(seed)
    while True:
        yield [_question(number, shop, drawn) for number in MIX]


def _question(number: int, shop: Shop, drawn: random.Random) -> Question:
    kinds = shop.leaves()
    if number == 1:
        kinds = _distinct([kind.above for kind in kinds if kind.above is not None])
    kind = drawn.choice(kinds)
    f1, f2, f3 = drawn.sample(kind.all_features(), 3)
    where = string.Template(QUERIES[number]).substitute(
        type=kind.iri, f1=f1, f2=f2, f3=f3, x=drawn.randint(1, 500), y=drawn.randint(1, 500),
        product=drawn.choice(shop.products), review=drawn.choice(shop.reviews),
        offer=drawn.choice(shop.offers), countries=COUNTRIES, now=_NOW,
    )  # fmt: skip
    return Question(number, _PREFIXES + where)


def _distinct(kinds: list[ProductType]) -> list[ProductType]:
    return list({kind.iri: kind for kind in kinds}.values())
