"""The embedded graph: store, named graphs, commits, blobs, inference, readers and change feed."""
