"""Scripts that search a page for faults and return them in words.

They cover what the usual checkers of accessibility look for and a page of ours could get wrong.
"""

from __future__ import annotations

__all__ = ["AUDITS", "CONTRAST", "SIDEWAYS", "SMALL_TARGETS"]

# Pairs of text and ground that occur: quiet text on panels, marks, buttons.
CONTRAST = """() => {
  const style = getComputedStyle(document.documentElement);
  const probe = document.createElement("i");
  document.body.append(probe);
  const rgb = (name) => {
    probe.style.color = style.getPropertyValue(name);
    return getComputedStyle(probe).color.match(/[\\d.]+/g).slice(0, 3).map(Number);
  };
  const luminance = (name) => {
    const [r, g, b] = rgb(name).map((v) => {
      const s = v / 255;
      return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const pairs = [["--ink", "--ground"], ["--ink", "--panel"], ["--quiet", "--ground"],
    ["--quiet", "--panel"], ["--quiet", "--soft"], ["--accent", "--panel"],
    ["--accent", "--ground"], ["--accent-ink", "--accent"],
    ["--good", "--good-soft"], ["--bad", "--bad-soft"]];
  const found = pairs.map(([a, b]) => {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return [`${a} on ${b}`, (high + 0.05) / (low + 0.05)];
  });
  probe.remove();
  return found;
}"""
# Tables become cards on a phone; only the answer of a query may have any number of columns.
SIDEWAYS = """() => [...document.querySelectorAll(".scroll, main")]
  .filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.textContent.trim().slice(0, 60))"""
# What a finger misses: lower than 44 px.
SMALL_TARGETS = """() => [...document.querySelectorAll("button, .button, select, summary")]
  .filter((e) => e.checkVisibility() && !e.classList.contains("visually-hidden")
    && e.getBoundingClientRect().height < 43.5)
  .map((e) => `${e.textContent.trim().slice(0, 40)}: ${e.getBoundingClientRect().height} px`)"""
AUDITS = {
    # What a screen reader could not name, and what the keyboard could not reach.
    "nameless": """() => [...document.querySelectorAll("a[href], button, input, select, textarea")]
      .filter((e) => e.type !== "hidden" && e.checkVisibility())
      .filter((e) => !(e.textContent.trim() || e.ariaLabel || e.labels?.length || e.title
        || e.querySelector("img[alt]:not([alt=''])") || e.ariaHidden === "true"))
      .map((e) => e.outerHTML.slice(0, 120))""",
    "image without words": """() => [...document.images]
      .filter((i) => !i.hasAttribute("alt")).map((i) => i.src)""",
    "id that occurs twice": """() => {
      const ids = [...document.querySelectorAll("[id]")].map((e) => e.id);
      return ids.filter((id, at) => ids.indexOf(id) !== at);
    }""",
    # WCAG 1.3.1: headings tell the outline, so that none may be skipped.
    "heading without one above": """() => {
      const levels = [...document.querySelectorAll("h1, h2, h3, h4")]
        .filter((e) => e.checkVisibility())
        .map((e) => [Number(e.tagName[1]), e.textContent.trim()]);
      return levels.filter(([level], at) => level > (at ? levels[at - 1][0] : 0) + 1)
        .map(([level, words]) => `h${level} ${words}`);
    }""",
    "reference to nothing": """() => ["aria-labelledby", "aria-describedby", "aria-controls", "for",
        "popovertarget", "list"]
      .flatMap((name) => [...document.querySelectorAll(`[${name}]`)].flatMap((e) =>
        e.getAttribute(name).split(" ").filter((id) => !document.getElementById(id))
          .map((id) => `${name}=${id}`)))""",
    "empty head of a column": """() => [...document.querySelectorAll("th")]
      .filter((e) => !e.textContent.trim()).map((e) => e.parentElement.textContent.trim())""",
    "code that keys cannot scroll": """() => [...document.querySelectorAll("pre")]
      .filter((e) => e.scrollWidth > e.clientWidth && e.tabIndex < 0)
      .map((e) => e.textContent.slice(0, 40))""",
    "table without heads": """() => [...document.querySelectorAll("table")]
      .filter((e) => e.checkVisibility() && !e.querySelector("th"))
      .map((e) => e.textContent.trim().slice(0, 60))""",
    "what takes the focus is hidden from screen readers": """() =>
      [...document.querySelectorAll("[aria-hidden=true]")]
      .flatMap((e) => [e, ...e.querySelectorAll("a[href], button, input, select, textarea")])
      .filter((e) => e.tabIndex >= 0 && e.checkVisibility())
      .map((e) => e.outerHTML.slice(0, 120))""",
}
"""Faults that no page may have, and the script that finds them."""
