"""RDF terms, namespaces, times and file formats."""
