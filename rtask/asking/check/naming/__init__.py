"""What the names in a query say: of misspelt terms, and of what variables stand for."""
