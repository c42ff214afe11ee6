"""RDF terms, namespaces, identifiers, documents and file formats."""
