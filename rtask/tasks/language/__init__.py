"""Goals in words: a grammar that reads all that a sentence can mean, and refuses what it doubts."""
