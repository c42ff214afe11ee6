"""Networks beside SIFT: vectors of one that the user brings, and a reader of print."""
