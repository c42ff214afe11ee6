"""Rules of the user: read, checked, and kept in the graph."""
