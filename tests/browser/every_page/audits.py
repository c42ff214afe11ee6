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
    # WCAG 2.5.3: somebody who speaks to the browser says the words that are seen.
    "called otherwise than it reads": """() => [...document.querySelectorAll(
        "a[href][aria-label], button[aria-label], summary[aria-label]")]
      .filter((e) => e.checkVisibility())
      .filter((e) => {
        const said = (text) => text.toLowerCase().replace(/[^\\p{L}\\p{N}]+/gu, " ").trim();
        return !said(e.ariaLabel).includes(said(e.innerText));
      })
      .map((e) => e.outerHTML.slice(0, 120))""",
    # Landmarks are what a screen reader jumps between: text outside of all of them is missed.
    "text outside of every landmark": """() => {
      const within = "main, header, footer, nav, aside, dialog, [role=status], [role=alert], .skip";
      const faults = [];
      const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) {
        const { textContent, parentElement } = walker.currentNode;
        if (textContent.trim() && parentElement.checkVisibility() && !parentElement.closest(within))
          faults.push(textContent.trim().slice(0, 60));
      }
      return faults;
    }""",
    # WCAG 1.4.3, of each text as it is seen: 4.5, and 3 where it is large.
    "text too faint": """() => {
      const parts = (colour) => (colour.match(/[\\d.]+/g) || []).map(Number);
      const over = ([r, g, b, a = 1], below) => [r, g, b].map((v, k) => a * v + (1 - a) * below[k]);
      const luminance = (rgb) => {
        const [r, g, b] = rgb.map((v) => v / 255)
          .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
      };
      const ground = (e) => {
        if (!e) return [255, 255, 255];
        const style = getComputedStyle(e);
        if (style.backgroundImage !== "none") return null; // a picture: nobody can say by styles
        const own = parts(style.backgroundColor);
        if (own[3] === undefined || own[3] === 1) return own.slice(0, 3);
        const below = ground(e.parentElement);
        return below && over(own, below);
      };
      const seen = new Map();
      const passed = "svg, [disabled], [aria-disabled=true], .visually-hidden, .skip";
      const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
      while (walker.nextNode()) {
        const text = walker.currentNode.textContent.trim();
        const e = walker.currentNode.parentElement;
        if (!text || seen.has(e) || e.closest(passed)) continue;
        if (!e.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
        const style = getComputedStyle(e);
        const below = ground(e);
        if (!below || !style.color.startsWith("rgb")) continue;
        const ink = luminance(over(parts(style.color), below));
        const [low, high] = [ink, luminance(below)].sort((x, y) => x - y);
        const size = parseFloat(style.fontSize);
        const large = size >= 24 || (size >= 18.66 && style.fontWeight >= 700);
        const ratio = (high + 0.05) / (low + 0.05);
        seen.set(e, ratio < (large ? 3 : 4.5) ? `${ratio.toFixed(2)}: ${text.slice(0, 40)}` : "");
      }
      return [...seen.values()].filter(Boolean);
    }""",
    "what takes the focus is hidden from screen readers": """() =>
      [...document.querySelectorAll("[aria-hidden=true]")]
      .flatMap((e) => [e, ...e.querySelectorAll("a[href], button, input, select, textarea")])
      .filter((e) => e.tabIndex >= 0 && e.checkVisibility())
      .map((e) => e.outerHTML.slice(0, 120))""",
}
"""Faults that no page may have, and the script that finds them."""
