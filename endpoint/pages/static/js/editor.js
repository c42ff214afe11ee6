// <sparql-editor>: CodeMirror around a text area that stays the field of the form. In a shadow root
// CodeMirror uses constructed style sheets, which the page's policy allows; in the document its
// style element would be blocked. Without the bundled library the text area does the work.

import { completions } from "./completion.js";

const CHECK_MS = 300;
const COLOURS = { keyword: "var(--accent)", string: "var(--good)", comment: "var(--quiet)", variableName: "var(--bad)", number: "var(--good)", name: "var(--ink)" };

/** Wait until an element is in sight, or nearly. */
function inSight(place) {
  return new Promise((resolve) => {
    const watch = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      watch.disconnect();
      resolve();
    });
    watch.observe(place);
  });
}

class SparqlEditor extends HTMLElement {
  #view = null;
  #library = null;
  #timer = 0;

  get field() {
    return this.querySelector("textarea");
  }

  async connectedCallback() {
    if (!this.dataset.library || this.shadowRoot) return;
    await inSight(this); // out of sight, the lines cannot be measured, and their numbers would stand elsewhere
    try {
      this.#library = await import(this.dataset.library);
    } catch {
      return; // the text area stays
    }
    const { EditorState, EditorView } = this.#library;
    const root = this.attachShadow({ mode: "open" });
    const hadFocus = document.activeElement === this.field;
    const state = EditorState.create({ doc: this.field.value, extensions: this.#extensions() });
    this.#view = new EditorView({ state, parent: root, root });
    if (hadFocus) this.#view.focus();
    this.dataset.ready = "";
    this.#check();
  }

  #extensions() {
    const m = this.#library;
    const look = m.HighlightStyle.define(
      Object.entries(COLOURS).map(([name, color]) => ({ tag: m.tags[name], color })),
    );
    const keys = [...m.closeBracketsKeymap, ...m.completionKeymap, ...m.historyKeymap, ...m.defaultKeymap];
    const run = { key: "Ctrl-Enter", mac: "Cmd-Enter", run: () => (this.field.form.requestSubmit(), true) };
    return [
      m.sparql(), m.history(), m.lineNumbers(), m.drawSelection(), m.bracketMatching(), m.closeBrackets(),
      m.highlightActiveLine(), m.lintGutter(), m.syntaxHighlighting(look), m.EditorView.lineWrapping,
      m.autocompletion({ override: [completions], icons: false }),
      m.keymap.of([run, ...keys]),
      m.EditorView.contentAttributes.of({ "aria-label": "Query", spellcheck: "false", autocapitalize: "off" }),
      m.EditorView.updateListener.of((update) => update.docChanged && this.#changed()),
      m.EditorView.theme({
        "&": { fontSize: ".9rem", minHeight: "18rem", color: "var(--ink)", backgroundColor: "var(--panel)", border: "1px solid var(--line)", borderRadius: "12px" },
        "&.cm-focused": { outline: "3px solid var(--accent)" },
        ".cm-content": { fontFamily: "var(--mono)", caretColor: "var(--ink)" },
        ".cm-cursor": { borderLeftColor: "var(--ink)" },
        ".cm-gutters": { backgroundColor: "var(--soft)", color: "var(--quiet)", border: "0", borderRadius: "12px 0 0 12px" },
        ".cm-activeLine": { backgroundColor: "transparent" },
        "&.cm-focused .cm-selectionBackground, .cm-selectionBackground": { background: "var(--soft) !important" },
        ".cm-tooltip": { backgroundColor: "var(--panel)", color: "var(--ink)", border: "1px solid var(--line)", maxWidth: "24rem" },
        ".cm-tooltip-autocomplete ul li[aria-selected]": { backgroundColor: "var(--accent)", color: "var(--accent-ink)" },
        ".cm-diagnostic": { whiteSpace: "pre-wrap" },
      }),
    ];
  }

  #changed() {
    this.field.value = this.#view.state.doc.toString();
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#check(), CHECK_MS);
  }

  /** Ask the server, whose parser decides, where the text is wrong. */
  async #check() {
    const text = this.field.value;
    const answer = await fetch("/sparql/check", {
      method: "POST", headers: { "Content-Type": "application/sparql-query" }, body: text,
    }).catch(() => null);
    if (!answer?.ok || text !== this.field.value) return;
    const found = text.trim() ? await answer.json() : { ok: true };
    this.mark(found.ok ? null : found, found.findings ?? []);
  }

  /** Mark a fault at its line and column, and findings with their repairs; none takes marks away. */
  mark(fault, findings = []) {
    if (!this.#view) return;
    const { setDiagnostics } = this.#library;
    const document_ = this.#view.state.doc;
    const diagnostics = [];
    if (fault) {
      const line = document_.line(Math.min(Math.max(fault.line ?? 1, 1), document_.lines));
      const from = Math.min(line.from + Math.max((fault.column ?? 1) - 1, 0), line.to);
      diagnostics.push({ from, to: Math.max(from, line.to), severity: "error", message: fault.detail });
    }
    for (const { start, end, severity, detail, repairs } of findings) {
      diagnostics.push({
        from: start, to: end, message: detail,
        severity: severity === "certain" ? "error" : "warning",
        actions: repairs.map(({ words, edits }) => ({
          name: words,
          apply: (view) => view.dispatch({ changes: edits.map((one) => ({ from: one.start, to: one.end, insert: one.text })) }),
        })),
      });
    }
    diagnostics.sort((one, other) => one.from - other.from);
    this.#view.dispatch(setDiagnostics(this.#view.state, diagnostics));
    this.dataset.findings = findings.length ? String(findings.length) : "";
    this.dataset.fault = fault ? `${fault.line ?? ""}:${fault.column ?? ""}` : "";
  }

  /** Show another text. */
  show(text) {
    this.field.value = text;
    this.#view?.dispatch({ changes: { from: 0, to: this.#view.state.doc.length, insert: text } });
  }
}

customElements.define("sparql-editor", SparqlEditor);
