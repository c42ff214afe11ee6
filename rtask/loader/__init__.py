"""Ontologies and data in and out: formats, the catalogue of imports, whole folders."""
