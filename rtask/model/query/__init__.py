"""Object queries: building, planning, compiling to SPARQL, assembling the answer."""
