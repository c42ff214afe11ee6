"""Choice of a visible object for a request in words (Gatto 2016, 5)."""
