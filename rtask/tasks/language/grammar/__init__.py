"""Grammar of goals: each rule yields every way in which it can read on from a word."""
