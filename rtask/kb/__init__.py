"""The knowledge base: a store, its named graphs, exact commits, blobs and what follows."""
