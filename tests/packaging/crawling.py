"""A walk along the links of a server's pages."""

from __future__ import annotations

import html
import re
from collections import Counter, deque
from dataclasses import dataclass
from urllib.parse import urljoin, urlsplit

import httpx

_LINK = re.compile(r'(?:href|src)="([^"#]+)')
_MAX_OF_A_SHAPE = 3


@dataclass(frozen=True)
class Visit:
    """An address that was asked for.

    Parameters
    ----------
    address
        Path and query.
    linked_from
        The page with the link.
    status
        Of the answer.
    text
        Of the answer, if it is a page.
    """

    address: str
    linked_from: str
    status: int
    text: str


def crawl(url: str, start: str = "/", most: int = 400) -> list[Visit]:
    """Ask for all that pages link to, as a browser that is not signed in does.

    Of addresses that differ in the values of their parameters only, three are asked for.

    Parameters
    ----------
    url
        Of the server, without a path.
    most
        Number of addresses after which the walk ends.
    """
    waiting, seen = deque([(start, "")]), {start}
    shapes: Counter[tuple[str, ...]] = Counter()
    visits: list[Visit] = []
    with httpx.Client(base_url=url, follow_redirects=True, timeout=120) as browser:
        while waiting and len(visits) < most:
            address, linked_from = waiting.popleft()
            answer = browser.get(address, headers={"Accept": "text/html"})
            is_page = "html" in answer.headers.get("content-type", "")
            text = answer.text if is_page else ""
            visits.append(Visit(address, linked_from, answer.status_code, text))
            for link in _LINK.findall(text):
                target = urlsplit(urljoin(str(answer.url), html.unescape(link)))
                if f"{target.scheme}://{target.netloc}" != url:
                    continue
                further = target.path + (f"?{target.query}" if target.query else "")
                shape = (target.path, *sorted(re.findall(r"(\w+)=", target.query)))
                if further in seen or shapes[shape] >= _MAX_OF_A_SHAPE:
                    continue
                seen.add(further)
                shapes[shape] += 1
                waiting.append((further, address))
    return visits
