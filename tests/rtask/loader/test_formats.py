"""Every serialisation, good and bad: errors name file, line and column, nothing is stored."""

from __future__ import annotations

import gzip
import io
import os
import threading
import zipfile
from pathlib import Path

import pytest
import zstandard

import rtask
from rtask.errors import DataError, ParseError, TooLargeError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.loader.bulk import TEXT_BYTES, readable_by_the_store
from rtask.rdf import documents
from rtask.rdf.bounds import MAX_IRI, MAX_LITERAL, MAX_NESTING
from rtask.rdf.documents import Document
from rtask.rdf.formats import detect, find_format, read_document


def _zipped(text: str, encrypted: bool) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("a.ttl", text)
    data = bytearray(packed.getvalue())
    directory = data.index(b"PK\x01\x02")
    data[6] = data[directory + 8] = int(encrypted)  # the first flag of either header
    return bytes(data)


_TURTLE = "@prefix e: <urn:e:> .\ne:Mug a e:Class ;\n  e:holds 0.3 .\n"
_XML = """<?xml version="1.0"?>
<!-- mugs -->
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:e="urn:e:">
  <rdf:Description rdf:about="urn:e:Mug"><e:holds>much</e:holds></rdf:Description>
</rdf:RDF>
"""
_OWL_XML = """<?xml version="1.0"?>
<Ontology xmlns="http://www.w3.org/2002/07/owl#" ontologyIRI="urn:o">
  <Declaration><Class IRI="urn:e:Mug"/></Declaration>
</Ontology>
"""
_FUNCTIONAL = "Prefix(e:=<urn:e:>)\nOntology(<urn:o>\nDeclaration(Class(e:Mug))\n)\n"
_MANCHESTER = "Prefix: e: <urn:e:>\nOntology: <urn:o>\nClass: e:Mug\n"
_JSON = '{"@id": "urn:e:Mug", "urn:e:holds": 3}\n'
_GOOD = {
    "ttl": _TURTLE,
    "trig": "GRAPH <urn:g> { <urn:e:Mug> <urn:p> 1 }\n",
    "nt": "<urn:e:Mug> <urn:p> <urn:o> .\n",
    "nq": "<urn:e:Mug> <urn:p> <urn:o> <urn:g> .\n",
    "rdf": _XML,
    "jsonld": _JSON,
    "n3": _TURTLE,
    "owx": _OWL_XML,
    "ofn": _FUNCTIONAL,
    "omn": _MANCHESTER,
}
_BAD = {
    "ttl": _TURTLE[:-3],
    "trig": "GRAPH <urn:g> { <urn:e:Mug> <urn:p>",
    "nt": "<urn:e:Mug> <urn:p>",
    "nq": "<urn:e:Mug> <urn:p> <urn:o> <urn:g>",
    "rdf": _XML[:-12],
    "jsonld": _JSON[:-3],
    "n3": _TURTLE[:-3],
    "owx": _OWL_XML[:-14],
    "ofn": _FUNCTIONAL[:-3],
    "omn": _MANCHESTER + "Klass: e:Cup\n",
}


def _file(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.fixture
def kb() -> KnowledgeBase:
    return rtask.open(":memory:", ontologies=False, reason=False)


@pytest.mark.parametrize("extension", _GOOD)
@pytest.mark.parametrize("change", ["as it is", "bom", "crlf"])
def test_a_good_document_is_read(
    tmp_path: Path, kb: KnowledgeBase, extension: str, change: str
) -> None:
    text = _GOOD[extension]
    if change == "bom":
        text = "\ufeff" + text
    if change == "crlf":
        text = text.replace("\n", "\r\n")
    report = kb.load(_file(tmp_path, f"mugs.{extension}", text))
    assert report.files[0].read >= 1
    assert kb.match("urn:e:Mug")
    assert kb.verify() == [] or {f.severity for f in kb.verify()} == {"note"}


@pytest.mark.parametrize("extension", _BAD)
def test_a_truncated_document_changes_nothing_and_says_where(
    tmp_path: Path, kb: KnowledgeBase, extension: str
) -> None:
    path = _file(tmp_path, f"mugs.{extension}", _BAD[extension])
    with pytest.raises(ParseError) as caught:
        kb.load(path)
    assert str(caught.value).startswith(f"{path}:")
    assert caught.value.details["line"] >= 1
    assert kb.seq == 0


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.ttl", "<urn:a> <urn:p> <urn:b c> .", ":1:"),
        ("a.ttl", "<urn:a> <urn:p> e:b .", ":1:"),
        ("a.ttl", "\n<urn:a> <urn:p> 'x'@9 .", ":2:"),
        ("a.nt", "<a> <urn:p> <urn:b> .", ":1:"),
        ("a.ttl", _XML, "it looks like rdfxml"),
        ("a.rdf", _TURTLE, "a.rdf:1:"),
        ("a.nt", _XML, "it looks like rdfxml"),
        ("a.ttl", b"\x00\x01\x02", "binary data"),
        ("a.nt", b"\x89PNG\r\n\x1a\n\x00\x00\x00", "binary data"),
        ("a.nt", "<urn:a> <urn:p> <urn:b> .".encode("utf-16-le"), "binary data"),
        ("a.ttl", "<urn:a> <urn:p> 1 .".encode("utf-16"), "UTF-16; expected UTF-8"),
        ("a.ttl", b"<urn:a> <urn:p> '\xff' .", "a.ttl"),
        ("a.rdf", "", "a.rdf:1:"),
        ("a.ttl.gz", b"\x1f\x8b\x08\x00garbage", "cannot be unpacked"),
        ("a.ttl.gz", b"\x1f\x8b\x08" + bytes(7) + b"\xff" * 40, "cannot be unpacked"),
        ("a.ttl.zst", zstandard.compress(_TURTLE.encode())[:-9], "ends within a frame"),
        ("a.ttl.zst", b"\x28\xb5\x2f\xfd" + b"\xff" * 40, "cannot be unpacked"),
        ("a.ttl.zip", _zipped(_TURTLE, encrypted=True), "is encrypted"),
    ],
)
def test_bad_input_is_named(
    tmp_path: Path, kb: KnowledgeBase, name: str, text: str | bytes, message: str
) -> None:
    with pytest.raises(ParseError, match=message):
        kb.load(_file(tmp_path, name, text))
    assert kb.seq == 0


def test_an_empty_turtle_file_is_a_graph_without_statements(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    report = kb.load(_file(tmp_path, "empty.ttl", ""))
    assert (report.files[0].read, report.added) == (0, 0)


@pytest.mark.parametrize(
    ("text", "form"),
    [
        (_TURTLE, "turtle"),
        ("# a comment\nPREFIX e: <urn:e:>\n", "turtle"),
        (_XML, "rdfxml"),
        ('<?xml version="1.0"?><!DOCTYPE rdf:RDF [ <!ENTITY e "urn:e:"> ]><rdf:RDF ', "rdfxml"),
        (_OWL_XML, "owlxml"),
        (_FUNCTIONAL, "functional"),
        (_MANCHESTER, "manchester"),
        (_JSON, "jsonld"),
        (_GOOD["nt"], "ntriples"),
    ],
)
def test_the_first_bytes_tell_the_format(tmp_path: Path, text: str, form: str) -> None:
    assert detect(Document("<bytes>", data=text.encode())).name == form
    assert detect(Document.of(_file(tmp_path, "mugs.owl", text))).name == form


def test_what_cannot_be_told_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot tell the format; name it with --format"):
        detect(Document("<bytes>", data=b"hello"))
    with pytest.raises(UsageError, match="unknown format 'docx'; one of turtle"):
        find_format("docx")
    with pytest.raises(UsageError, match="does not exist"):
        Document.of(tmp_path / "absent.ttl")
    assert find_format("application/ld+json; profile=x").name == "jsonld"


def test_packed_files_are_unpacked(tmp_path: Path, kb: KnowledgeBase) -> None:
    data = _TURTLE.encode()
    files = {
        "a.ttl.gz": gzip.compress(data),
        "b.ttl.zst": zstandard.compress(data[:30]) + zstandard.compress(data[30:]),
    }
    paths = [_file(tmp_path, name, content) for name, content in files.items()]
    packed = tmp_path / "c.ttl.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("c.ttl", _TURTLE)
    for path in [*paths, packed]:
        assert kb.load(path).files[0].read == 2
    assert kb.match(graph=kb.graphs.imported("a"))
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("one.ttl", _TURTLE)
        archive.writestr("two.ttl", _TURTLE)
    with pytest.raises(DataError, match="holds 2 files"):
        kb.load(packed)


def test_a_pipe_is_read_once(tmp_path: Path, kb: KnowledgeBase) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=(_TURTLE,))
    writer.start()
    assert kb.load(pipe).files[0].read == 2
    writer.join()


def test_a_file_opened_as_text_is_refused(tmp_path: Path) -> None:
    with (
        _file(tmp_path, "a.ttl", _TURTLE).open() as file,
        pytest.raises(UsageError, match="opened with mode 'rb'"),
    ):
        Document.of(file)  # type: ignore[arg-type] # what callers without types do


def test_brackets_that_nest_nothing_are_no_depth(tmp_path: Path) -> None:
    text = """<urn:a> <urn:p> ( [ <urn:(((> "(([[" ] '[[[' ) . # (((
@prefix e: <urn:e#> . e:a\\(b <urn:p> '''( ' [ ''', (), [] .
"""
    assert len(read_document(_file(tmp_path, "a.ttl", text * 100))) == 900


def test_a_literal_beyond_the_bound_is_refused_on_every_way_in(tmp_path: Path) -> None:
    long = "x" * (MAX_LITERAL + 1)
    text = f"<urn:a> <urn:p> '{long}' ."
    with rtask.open(tmp_path / "kb") as kb:
        for write in (
            lambda: kb.update(f"INSERT DATA {{ {text} }}"),
            lambda: kb.load(text.encode(), format="turtle"),
            lambda: kb.load(_file(tmp_path, "a.nt", (text.replace("'", '"') + "\n") * 17)),
        ):
            with pytest.raises(TooLargeError, match=f"literal.*{MAX_LITERAL}"):
                write()
        with kb.transaction() as tx:
            tx.add("urn:a", "urn:p", long[1:])
        escaped = "\\u0078" * 300_000
        assert kb.update(f"INSERT DATA {{ <urn:b> <urn:p> '{escaped}' }}").added == 1
        assert kb.update("INSERT { <urn:c> ?p ?o } WHERE { <urn:a> ?p ?o }").added == 1


@pytest.mark.parametrize(
    "triple",
    [
        f"<urn:a> <urn:p> <urn:{'x' * MAX_IRI}> .",
        f"<urn:{'x' * MAX_IRI}> <urn:p> 1 .",
        f"<urn:a> <urn:p> '1'^^<urn:{'x' * MAX_IRI}> .",
        f"<urn:a> <urn:p> 'x'@en{'-aaaaaaaa' * (MAX_IRI // 9 + 1)} .",
        f"<urn:a> <urn:p> <<( <urn:a> <urn:p> <urn:{'x' * MAX_IRI}> )>> .",
        f"PREFIX x: <urn:{'x' * (MAX_IRI - 9)}>\nx:abcdefghi <urn:p> 1 .",
    ],
    ids=["object", "subject", "datatype", "language", "triple term", "prefix"],
)
def test_a_name_beyond_the_bound_is_refused_on_every_way_in(tmp_path: Path, triple: str) -> None:
    head, _, data = triple.rpartition("\n")
    with rtask.open(tmp_path / "kb", ontologies=False) as kb:
        for write in (
            lambda: kb.update(f"{head} INSERT DATA {{ {data} }}"),
            lambda: kb.load(triple.encode(), format="turtle"),
        ):
            with pytest.raises(TooLargeError, match=f"IRI.*{MAX_IRI}"):
                write()
        assert not kb.match(predicate="urn:p")


def test_a_long_line_is_read_by_us_since_it_may_hold_a_long_name(tmp_path: Path) -> None:
    short = f"<urn:{'x' * (MAX_IRI - 30)}> <urn:p> 1 .\n"
    lines = short * (TEXT_BYTES // len(short) + 1)
    for text, is_read_by_the_store in ((lines, True), (lines + "x" * 30 + short, False)):
        document = Document.of(_file(tmp_path, "a.nt", text))
        assert readable_by_the_store(document, detect(document)) is is_read_by_the_store


def test_a_token_without_an_end_is_too_large_and_no_fault_of_ours(tmp_path: Path) -> None:
    with pytest.raises(TooLargeError, match="without an end"):
        read_document(_file(tmp_path, "a.ttl", "#" * (17 << 20)))


def test_a_bomb_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(documents, "MAX_UNPACKED", 10_000)
    for name, pack in (("bomb.ttl.gz", gzip.compress), ("bomb.ttl.zst", zstandard.compress)):
        path = _file(tmp_path, name, pack(b"\n" * 1_000_000))
        with pytest.raises(TooLargeError, match="unpacked"):
            read_document(path)


@pytest.mark.parametrize(
    ("name", "text", "error", "message"),
    [
        ("a.jsonld", '{"urn:p":' * 5_000, TooLargeError, "nested deeper than 128"),
        ("a.ttl", "<urn:a> <urn:p> " + "[ <urn:p> " * 9_000, TooLargeError, "deeper than 128"),
        ("a.ttl", "<urn:a> <urn:p> " + "( " * 129 + ") " * 129, TooLargeError, "deeper than 128"),
        ("a.trig", "<urn:g> { <urn:a> <urn:p> " + "( " * 129, TooLargeError, "deeper than 128"),
        ("a.n3", "<urn:a> <= " + "{ <urn:a> <= " * 129, TooLargeError, "deeper than 128"),
        ("a.ttl", "<urn:a> <urn:p> '\"', " + "( " * 129 + "'\"'", TooLargeError, "than 128"),
        ("a.ofn", "Ontology(" + "ObjectComplementOf(" * 9_000, TooLargeError, "than 128"),
        ("a.ttl", "<urn:a> <urn:p> " + "<<( <urn:a> <urn:p> " * 9_000, TooLargeError, "nested"),
        ("a.rdf", "<a>" * 300, TooLargeError, "nested deeper than 128"),
        (
            "a.rdf",
            '<!DOCTYPE x [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><x>&b;</x>',
            ParseError,
            "entity b refers to another entity",
        ),
        (
            "a.rdf",
            '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><x>&a;</x>',
            ParseError,
            "is external",
        ),
        ("a.rdf", '<?xml version="1.0" encoding="no-such"?><a/>', ParseError, "write .* in UTF-8"),
        (
            "a.jsonld",
            '{"@context": "http://127.0.0.1:1/c", "@id": "urn:a"}',
            ParseError,
            "a.jsonld",
        ),
    ],
)
def test_hostile_documents_are_refused(
    tmp_path: Path, name: str, text: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        read_document(_file(tmp_path, name, text))


def test_brackets_in_strings_are_not_depth() -> None:
    text = '{"@id": "urn:a", "urn:p": "' + "[{" * 1_000 + '"}'
    assert len(read_document(text, "jsonld")) == 1
    assert len(read_document(f'<urn:a> <urn:p> "{"<<( " * 1_000}" .', "turtle")) == 1


def test_nested_blank_nodes_are_read_down_to_the_bound_and_refused_beyond() -> None:
    def nested(depth: int) -> str:
        return "<urn:a> <urn:p> " + "[ <urn:p> " * depth + "1" + " ]" * depth + " ."

    assert len(read_document(nested(MAX_NESTING), "turtle")) == MAX_NESTING + 1
    beside = "<urn:b> <urn:p> [] ."  # more brackets than may be nested, each no deeper than that
    assert len(read_document(nested(MAX_NESTING) + beside, "turtle")) == MAX_NESTING + 2
    with pytest.raises(TooLargeError, match=f"nested deeper than {MAX_NESTING}"):
        read_document(nested(MAX_NESTING + 1), "turtle")


def test_a_literal_may_hold_any_character_of_unicode_nul_included(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    kb.load(_file(tmp_path, "a.nt", '<urn:a> <urn:p> "x\x00\x07\\r\ty" .\n'))
    assert [quad.object.value for quad in kb.match("urn:a", "urn:p")] == ["x\x00\x07\r\ty"]
