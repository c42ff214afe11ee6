"""Loading: graphs, imports, folders, dry runs, large files; and out again."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from pathlib import Path

import pyoxigraph as ox
import pytest

import ontology
import rtask
from rtask.errors import (
    DataError,
    ForbiddenError,
    ParseError,
    StoreError,
    UnknownTermError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.loader.catalogue import MAX_PEEKED_BYTES, OntologyCatalogue
from rtask.loader.export import original
from rtask.rdf.documents import Document
from rtask.rdf.namespaces import uuid7
from rtask.rdf.terms import BlankNode, NamedNode, iri

_OWL = "http://www.w3.org/2002/07/owl#"


def _ontology(name: str, imports: str = "", more: str = "") -> str:
    imported = "".join(f" ; owl:imports <{i}>" for i in imports.split())
    return f"@prefix owl: <{_OWL}> .\n<urn:o:{name}> a owl:Ontology{imported} .\n{more}"


@pytest.fixture
def kb() -> KnowledgeBase:
    return rtask.open(":memory:", base="urn:lab/", ontologies=False, reason=False)


def _write(folder: Path, **files: str) -> None:
    for name, text in files.items():
        (folder / f"{name}.ttl").write_text(text)


def test_an_ontology_goes_to_its_own_graph_and_data_to_one_of_the_file(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    _write(tmp_path, a=_ontology("a"), data="<urn:x> <urn:p> 1 .")
    kb.load(tmp_path)
    assert kb.catalogue.is_ontology(iri("urn:o:a"))
    assert kb.catalogue.ontologies() == [iri("urn:o:a")]
    [quad] = kb.match("urn:x")
    assert quad.graph_name == iri("urn:lab/graph/import/data")
    assert kb.catalogue.kind(quad.graph_name) == "ImportGraph"
    kb.load(tmp_path / "data.ttl", graph="urn:g")
    assert len(kb.match("urn:x")) == 2


def test_a_file_is_one_commit_and_a_bad_one_none(tmp_path: Path, kb: KnowledgeBase) -> None:
    _write(tmp_path, a="<urn:x> <urn:p> 1, 2 .", b="<urn:x> <urn:p> 3 .\n<urn:x> <urn:p")
    with pytest.raises(ParseError, match=r"b\.ttl:2:"):
        kb.load(tmp_path)
    assert kb.seq == 1
    assert len(kb.match("urn:x")) == 2


def test_imports_are_found_beside_the_file_and_cycles_end(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    _write(
        tmp_path,
        top=_ontology("top", "urn:o:mid"),
        mid=_ontology("mid", "urn:o:top urn:o:leaf"),
        leaf=_ontology("leaf"),
    )
    report = kb.load(tmp_path / "top.ttl")
    assert [Path(file.name).stem for file in report.files] == ["leaf", "mid", "top"]
    assert len(kb.catalogue.ontologies()) == 3
    assert kb.load(tmp_path / "top.ttl").added == 0  # nothing is loaded twice


def test_an_import_by_package_is_found_where_ros_and_the_caller_have_it(
    tmp_path: Path, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    robots = tmp_path / "kitchen" / "owl" / "robots"
    installed, moved = tmp_path / "ws" / "share" / "arms" / "owl", tmp_path / "elsewhere"
    for folder in (robots, installed, moved):
        folder.mkdir(parents=True)
    _write(robots.parent, base=_ontology("base"))
    _write(installed, arm=_ontology("arm"))
    _write(moved, parts=_ontology("parts"))
    named = ["kitchen/owl/base.ttl", "arms/owl/arm.ttl", "gone/owl/parts.ttl"]
    _write(robots, top=_ontology("top", " ".join(f"package://{path}" for path in named)))
    # The package of the third exists no more; the caller's folder has a file of its name.
    with pytest.raises(DataError, match=r"imports package://gone/owl/parts\.ttl; searched"):
        kb.load(robots / "top.ttl")
    report = kb.load(robots / "top.ttl", catalogs=[moved])
    assert [Path(file.name).stem for file in report.files][-2:] == ["parts", "top"]
    (warning,) = report.warnings
    assert "a package that is not here" in warning
    assert "parts.ttl was read, which has its name" in warning
    assert {f"urn:o:{name}" for name in ("arm", "base", "parts", "top")} == {
        name.value for name in kb.catalogue.ontologies()
    }


def test_an_import_by_package_names_nothing_outside_of_packages(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    (tmp_path / "robots").mkdir()
    _write(tmp_path, secret=_ontology("secret"))
    _write(tmp_path / "robots", top=_ontology("top", "package://robots/../secret.ttl"))
    with pytest.raises(DataError, match="searched"):
        kb.load(tmp_path / "robots" / "top.ttl")


def test_a_missing_import_names_the_file_that_may_be_meant(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    _write(tmp_path, top=_ontology("top", "urn:o:All"), all=_ontology("ALL"))
    with pytest.raises(DataError, match=r"where .*all\.ttl calls itself urn:o:ALL; name"):
        kb.load(tmp_path / "top.ttl")


def test_a_missing_import_lists_where_it_was_looked_for(
    tmp_path: Path, kb: KnowledgeBase, caplog: pytest.LogCaptureFixture
) -> None:
    _write(tmp_path, top=_ontology("top", "urn:o:gone"))
    places = tmp_path / "places"
    places.mkdir()
    with pytest.raises(DataError, match=f"imports urn:o:gone; searched {places}, {tmp_path}"):
        kb.load(tmp_path / "top.ttl", catalogs=[places])
    assert kb.seq == 0
    report = kb.load(tmp_path / "top.ttl", missing_imports="warn")
    assert report.missing_imports == ["urn:o:gone"]
    assert "urn:o:gone" in caplog.text
    with pytest.raises(UsageError, match="one of error, warn, ignore"):
        kb.load(tmp_path / "top.ttl", missing_imports="maybe")


def test_a_missing_import_unpacks_no_more_than_the_beginning_of_unrelated_files(
    tmp_path: Path, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "top.ttl").write_text(
        "<urn:o:top> a <http://www.w3.org/2002/07/owl#Ontology> ; "
        "<http://www.w3.org/2002/07/owl#imports> <urn:o:gone> ."
    )
    # one line of 64 MiB: nothing of it can be parsed before all of it was unpacked
    with zipfile.ZipFile(tmp_path / "big.ttl.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("big.ttl", '<urn:s> <urn:p> "' + "x" * (64 << 20) + '" .')
    unpacked: list[int] = []
    read = zipfile.ZipExtFile.read

    def count(self: zipfile.ZipExtFile, size: int = -1) -> bytes:
        data = read(self, size)
        unpacked.append(len(data))
        return data

    monkeypatch.setattr(zipfile.ZipExtFile, "read", count)
    report = kb.load(tmp_path / "top.ttl", missing_imports="warn")
    assert report.missing_imports == ["urn:o:gone"]
    assert 0 < sum(unpacked) < 2 * MAX_PEEKED_BYTES


def test_catalogues_name_other_places(tmp_path: Path, kb: KnowledgeBase) -> None:
    (tmp_path / "far").mkdir()
    _write(tmp_path / "far", leaf=_ontology("leaf"))
    _write(tmp_path, top=_ontology("top", "urn:any:name"))
    oasis = tmp_path / "catalog-v001.xml"
    oasis.write_text(
        '<catalog xmlns="urn:oasis:names:tc:entity:xmlns:xml:catalog">'
        '<uri name="urn:any:name" uri="far/leaf.ttl"/>'
        '<uri name="urn:web" uri="http://127.0.0.1:1/x"/></catalog>'
    )
    assert OntologyCatalogue().find("urn:web", tmp_path / "top.ttl") is None
    report = kb.load(tmp_path / "top.ttl")
    assert [Path(file.name).stem for file in report.files] == ["leaf", "top"]


@pytest.mark.parametrize(
    ("text", "undefined"),
    [
        ({"@id": "urn:a", "urn:p": 1, "lost": 2}, ["lost"]),
        ({"@context": {"p": "urn:p"}, "@id": "urn:a", "p": {"q": 1}}, ["q"]),
        ({"@context": {"@vocab": "urn:v/"}, "@id": "urn:a", "anything": 1}, []),
        ({"@context": {"p": "urn:p", "off": None}, "@id": "urn:a", "p": 1, "off": 2}, []),
        (
            {
                "@context": {"p": {"@id": "urn:p", "@container": "@language"}},
                "@id": "urn:a",
                "p": {"de": "Tasse", "en": "cup"},
            },
            [],
        ),
        (
            {
                "@context": {"p": {"@id": "urn:p", "@type": "@json"}},
                "@id": "urn:a",
                "p": {"free": 1},
            },
            [],
        ),
        ([{"@context": [{"p": "urn:p"}, None], "@id": "urn:a", "urn:q": 1, "p": 1}], ["p"]),
    ],
)
def test_json_ld_keys_that_no_context_defines_are_told(
    kb: KnowledgeBase, text: object, undefined: list[str]
) -> None:
    report = kb.load(json.dumps(text).encode(), format="jsonld")
    warnings = [warning for warning in report.warnings if "no context defines" in warning]
    assert len(warnings) == bool(undefined)
    assert all(name in warnings[0] for name in undefined)


def test_bundled_ontologies_are_found_by_name(kb: KnowledgeBase) -> None:
    report = kb.load("http://purl.org/ieee1872-owl/cora-bare")
    assert {file.graph for file in report.files} >= {
        "http://purl.org/ieee1872-owl/cora-bare",
        "http://purl.org/ieee1872-owl/sumo-cora",
    }
    with pytest.raises(DataError, match="neither a file nor a known ontology"):
        kb.load("http://127.0.0.1:1/x")


def test_every_catalogued_file_is_what_the_catalogue_says() -> None:
    catalogue = OntologyCatalogue()
    for path in ontology.modules():
        assert path.is_file()
    assert catalogue.find(ontology.ONTOLOGY) == ontology.path("rtask.ttl")


def test_two_files_that_claim_one_ontology_are_named(tmp_path: Path, kb: KnowledgeBase) -> None:
    _write(tmp_path, top=_ontology("top", "urn:o:a"), a=_ontology("a"))
    _write(tmp_path, again=_ontology("a"))
    kb.load(tmp_path / "top.ttl")  # the same content is no conflict
    _write(
        tmp_path, again=_ontology("a", more="<urn:x> <urn:p> 1 ."), top2=_ontology("t", "urn:o:b")
    )
    kb.load(tmp_path / "top2.ttl", missing_imports="ignore")  # it asks for neither
    other = rtask.open(":memory:", ontologies=False, reason=False)
    with pytest.raises(DataError, match=r"a\.ttl and .*again\.ttl both claim to be urn:o:a"):
        other.load(tmp_path / "top.ttl")


def test_a_dry_run_counts_and_stores_nothing(tmp_path: Path, kb: KnowledgeBase) -> None:
    _write(tmp_path, top=_ontology("top", "urn:o:leaf"), leaf=_ontology("leaf"))
    report = kb.load(tmp_path / "top.ttl", dry_run=True)
    assert report.dry_run
    assert [file.added for file in report.files] == [1, 2]
    assert kb.seq == 0
    assert list(kb.blobs.digests()) == []


def test_replacing_withdraws_what_was_there(tmp_path: Path, kb: KnowledgeBase) -> None:
    _write(tmp_path, a="<urn:x> <urn:p> 1, 2 .")
    kb.load(tmp_path / "a.ttl")
    _write(tmp_path, a="<urn:x> <urn:p> 2, 3 .")
    report = kb.load(tmp_path / "a.ttl", replace=True)
    assert (report.files[0].added, report.files[0].removed) == (1, 1)
    assert sorted(q.object.value for q in kb.match("urn:x")) == ["2", "3"]  # type: ignore[union-attr]


def test_blank_nodes_of_data_become_iris_and_those_of_ontologies_stay(
    tmp_path: Path, kb: KnowledgeBase
) -> None:
    restriction = "<urn:C> <urn:sub> [ <urn:on> <urn:p> ] ."
    _write(tmp_path, data="<urn:x> <urn:p> [ <urn:q> 1 ] .", onto=_ontology("a", more=restriction))
    kb.load(tmp_path)
    [quad] = kb.match("urn:x")
    assert isinstance(quad.object, NamedNode)
    assert quad.object.value.startswith("urn:lab/.well-known/genid/")
    assert kb.match(quad.object, "urn:q")
    assert isinstance(kb.match("urn:C")[0].object, BlankNode)
    kb.load(tmp_path / "onto.ttl")
    assert len(kb.match("urn:C")) == 1  # the same bytes again add nothing


def test_datasets_name_their_own_graphs(kb: KnowledgeBase) -> None:
    data = b"<urn:a> <urn:p> 1 . <urn:g> { <urn:a> <urn:p> 2 }"
    kb.load(data, format="trig", graph="urn:rest")
    assert {str(q.graph_name) for q in kb.match("urn:a")} == {"<urn:rest>", "<urn:g>"}


def test_loading_needs_the_right_to_write(kb: KnowledgeBase) -> None:
    robot = Access("nao-1", "robot")
    with pytest.raises(ForbiddenError):
        kb.load(b"<urn:a> <urn:p> 1 .", format="turtle", access=robot)
    kb.load(b"<urn:a> <urn:p> 1 .", format="turtle", access=robot, graph=kb.graphs.agent("nao-1"))


def test_statements_given_as_text_are_refused_in_one_line(kb: KnowledgeBase) -> None:
    text = "<urn:a> <urn:b> <urn:c> .\n" * 5_000
    with pytest.raises(UsageError, match=r"130000 characters .* as bytes") as error:
        kb.load(text, format="nt")
    assert len(str(error.value)) < 200


def test_streams_are_read(kb: KnowledgeBase) -> None:
    kb.load(io.BytesIO(b"<urn:a> <urn:p> <urn:b> ."), format="nt", graph="urn:g")
    assert len(kb.match("urn:a")) == 1


@pytest.mark.slow
def test_a_large_file_is_streamed_and_leaves_the_same_as_a_small_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "".join(f"<urn:s{n}> a <urn:Mug> .\n" for n in range(250))
    text += "<urn:s1> a <urn:Mug> .\n"  # twice, counted once
    text += "<urn:Mug> <http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:Vessel> .\n"
    (tmp_path / "big.nt").write_text(
        text.replace(" a ", " <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> ")
    )
    contents = []
    for limit in (100, 100_000):
        monkeypatch.setattr("rtask.loader.load.MAX_QUADS", limit)
        with rtask.open(tmp_path / f"kb{limit}", base="urn:lab/", ontologies=False) as kb:
            kb.update("INSERT DATA { <urn:s1> a <urn:Mug> }")
            report = kb.load(tmp_path / "big.nt")
            assert (report.files[0].read, report.files[0].added) == (252, 251)
            assert kb.query("ASK { <urn:s249> a <urn:Vessel> }") is True
            assert kb.verify() == []
            assert kb.stats()["closure"] == "current"
            records = (kb.graphs.meta, kb.graphs.provenance)
            contents.append({str(q) for q in kb.match() if q.graph_name not in records})
            kb.load(tmp_path / "big.nt", replace=True)
            assert kb.verify() == []
    assert contents[0] == contents[1]


def test_a_large_load_is_announced_and_numbered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 2)
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        heard: list[int] = []
        kb.on_commit(lambda change: heard.append(change.commit.seq))
        kb.load(b"<urn:a> <urn:p> 1, 2, 3 .", format="turtle", graph="urn:g")
        kb.update("INSERT DATA { <urn:b> <urn:p> 1 }")
        assert heard == [1, 2]
        assert kb.catalogue.revision(iri("urn:g")) == 1


def test_what_a_large_load_contradicts_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 2)
    with rtask.open(":memory:", ontologies=False) as kb:
        kb.load(
            f"<urn:A> <{_OWL}disjointWith> <urn:B> . <urn:x> a <urn:A>, <urn:B> .".encode(),
            format="turtle",
        )
        assert len(kb.contradictions()) == 1
    assert "1 contradictions, e.g." in caplog.text


def test_dumps_come_back_the_same(tmp_path: Path, kb: KnowledgeBase) -> None:
    kb.load(
        _ontology(
            "a", more='<urn:C> <urn:sub> [ owl:maxCardinality 1 ; <urn:l> ( 1 "x"@en ) ] .'
        ).encode(),
        format="turtle",
    )
    for name in ("g.ttl", "g.nt", "g.rdf", "g.jsonld", "all.trig", "all.nq"):
        path = tmp_path / name
        single = name.startswith("g.")
        count = kb.dump(path, graphs=["urn:o:a"] if single else None)
        assert count == len(list(ox.parse(path=path)))
        triples = [
            ox.parse(path=path),
            kb.store.quads_for_pattern(None, None, None, iri("urn:o:a")),
        ]
        if single:
            forms = []
            for quads in triples:
                dataset = ox.Dataset(ox.Quad(*map(_stored, q.triple)) for q in quads)
                dataset.canonicalize(ox.CanonicalizationAlgorithm.UNSTABLE)
                forms.append(set(map(str, dataset)))
            assert forms[0] == forms[1], name
    assert "nonNegativeInteger" in (tmp_path / "g.nt").read_text()
    assert not list(tmp_path.glob("*.part"))


def _stored(term: object) -> object:
    from rtask.rdf.terms import stored

    return stored(term)  # type: ignore[arg-type]


def test_exports_that_cannot_be_are_refused(tmp_path: Path, kb: KnowledgeBase) -> None:
    with pytest.raises(UnknownTermError, match="no graph"):
        kb.dump(tmp_path / "x.ttl", graphs=["urn:absent"])
    with pytest.raises(UsageError, match="can be read but not written"):
        kb.dump(tmp_path / "x.omn")
    with pytest.raises(UsageError, match="format is required"):
        kb.dump(io.BytesIO())
    assert list(tmp_path.iterdir()) == []


def test_the_original_bytes_are_kept(tmp_path: Path, kb: KnowledgeBase) -> None:
    text = _ontology("a", more="# a comment, and 01 as written\n<urn:x> <urn:p> 01 .\n")
    _write(tmp_path, a=text)
    kb.load(tmp_path / "a.ttl")
    original(kb, "urn:o:a", tmp_path / "out.ttl")
    assert (tmp_path / "out.ttl").read_text() == text
    source = kb.catalogue.source(iri("urn:o:a"))
    assert source is not None
    assert source.value.endswith(hashlib.sha256(text.encode()).hexdigest())
    with pytest.raises(UnknownTermError, match="no original"):
        original(kb, "urn:other", tmp_path / "out.ttl")


def test_plain_stores_load_into_the_default_graph(tmp_path: Path) -> None:
    with rtask.open(":memory:", plain=True) as kb:
        kb.load(b"<urn:a> <urn:p> _:b .", format="turtle")
        [quad] = kb.match("urn:a")
        assert isinstance(quad.graph_name, ox.DefaultGraph)
        assert isinstance(quad.object, BlankNode)


@pytest.mark.slow
def test_real_ontologies_in_many_syntaxes_load(ontologies_dir: Path) -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        for name in ("soma/SOMA-OBJ.owl", "w3c/time.jsonld", "w3c/ssn.ttl", "cora/corax.owl"):
            report = kb.load(ontologies_dir / name, missing_imports="ignore")
            assert report.files[-1].read > 100
        assert [f for f in kb.verify() if f.severity == "error"] == []


def test_uuids_sort_by_time() -> None:
    first = str(uuid7())
    assert first[14] == "7"
    assert first[19] in "89ab"
    assert len({uuid7() for _ in range(100)}) == 100


@pytest.mark.parametrize("union", ["merged", "view"])
def test_what_the_store_reads_by_itself_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, union: str
) -> None:
    lines = [f"<urn:s{n}> <urn:p> {n}, {n + 1} .\n" for n in range(100)]
    (tmp_path / "data.ttl").write_text("".join(lines) + lines[0])
    contents = []
    for limit in (1 << 40, 10):
        monkeypatch.setattr("rtask.loader.bulk.TEXT_BYTES", limit)
        folder = tmp_path / f"{union}{limit}"
        with rtask.open(folder, base="urn:lab/", ontologies=False, union=union) as kb:
            report = kb.load(tmp_path / "data.ttl")
            assert (report.files[0].added, kb.seq) == (200, 1)
            assert kb.select("SELECT (COUNT(*) AS ?n) { ?s <urn:p> ?o }")[0].value("n") == 200
            assert kb.verify() == []
            contents.append({str(quad) for quad in kb.match(predicate="urn:p")})
    assert contents[0] == contents[1]


def test_a_large_text_that_is_malformed_at_its_end_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.loader.bulk.TEXT_BYTES", 10)
    (tmp_path / "data.nt").write_text("<urn:a> <urn:p> <urn:b> .\n" * 50 + "<urn:a> <urn:p\n")
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        with pytest.raises(ParseError, match=r"data\.nt:51:"):
            kb.load(tmp_path / "data.nt")
        assert kb.seq == 0
        assert len(kb.store) == 0
        assert not (tmp_path / "kb" / "loading.json").exists()
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")


def test_a_load_that_stopped_before_the_union_is_completed_by_opening_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtask.loader.bulk.TEXT_BYTES", 10)
    (tmp_path / "data.nt").write_text("<urn:a> <urn:p> <urn:b> .\n" * 50)
    opened = []

    def stop_at_the_union(document: Document) -> object:
        opened.append(document)
        if len(opened) == 3:  # marks, graph, union
            raise KeyboardInterrupt
        return open_document(document)

    open_document = Document.open
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        monkeypatch.setattr(Document, "open", stop_at_the_union)
        with pytest.raises(KeyboardInterrupt):
            kb.load(tmp_path / "data.nt", format="ntriples")
        monkeypatch.undo()
        with pytest.raises(StoreError, match="open the knowledge base again"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        assert kb.query("ASK { <urn:a> <urn:p> <urn:b> }") is True
        assert [f for f in kb.verify() if f.severity == "error"] == []
