// What the query editor offers: prefixes, classes after `a`, properties elsewhere, and variables.

const MAX_OFFERED = 200;
let known = null; // asked for once, when something is typed

async function vocabulary() {
  known ??= fetch("/terms.json").then((answer) => (answer.ok ? answer.json() : { prefixes: {}, terms: [] }));
  return known;
}

/** Prefixes that a query declares, by name. */
function declared(text) {
  const found = {};
  for (const [, name, iri] of text.matchAll(/\bPREFIX\s+([\w.-]*):\s*<([^>]*)>/gi)) found[name] = iri;
  return found;
}

function variables(text, except) {
  const names = new Set(text.match(/[?$]\w+/g) ?? []);
  names.delete(except);
  return [...names].map((label) => ({ label, type: "variable" }));
}

/** Put a name in, and declare its prefix where that is missing. */
function applyWith(prefix, iri, missing) {
  return (view, completion, from, to) => {
    const changes = [{ from, to, insert: completion.label }];
    const line = missing ? `PREFIX ${prefix}: <${iri}>\n` : "";
    if (line) changes.unshift({ from: 0, insert: line });
    view.dispatch({ changes, selection: { anchor: from + line.length + completion.label.length } });
  };
}

function named(terms, prefix, iri, missing, wanted) {
  const found = [];
  for (const term of terms) {
    if (!term.iri.startsWith(iri) || (wanted && term.kind !== wanted)) continue;
    const local = term.iri.slice(iri.length);
    if (!/^[\w-]+$/.test(local)) continue;
    found.push({
      label: `${prefix}:${local}`,
      detail: missing ? `${term.label ?? ""} (declares ${prefix}:)` : term.label ?? "",
      info: term.comment ?? undefined,
      apply: applyWith(prefix, iri, missing),
    });
  }
  return found.slice(0, MAX_OFFERED);
}

/** The source that CodeMirror asks (CompletionSource). */
export async function completions(context) {
  const word = context.matchBefore(/[?$]?[\w.:-]*/);
  if (!word || (word.from === word.to && !context.explicit)) return null;
  const text = context.state.doc.toString();
  if (/^[?$]/.test(word.text)) return { from: word.from, options: variables(text, word.text), validFor: /^[?$]\w*$/ };
  const { prefixes, terms } = await vocabulary();
  const own = declared(text);
  const all = { ...prefixes, ...own };
  const before = context.state.sliceDoc(Math.max(0, word.from - 40), word.from);
  const wanted = /(^|\s)a\s+$/.test(before) ? "class" : /[?$]\w+\s+$|;\s*$/.test(before) ? "property" : "";
  const [prefix, local] = word.text.split(":");
  if (local !== undefined) {
    if (!(prefix in all)) return null;
    const options = named(terms, prefix, all[prefix], !(prefix in own), wanted);
    return { from: word.from, options, validFor: /^[\w.-]*:[\w-]*$/ };
  }
  const options = Object.entries(all).map(([name, iri]) => ({
    label: `${name}:`, detail: iri, apply: applyWith(name, iri, !(name in own)),
  }));
  return { from: word.from, options, validFor: /^[\w.-]*$/ };
}
