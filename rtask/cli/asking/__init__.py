"""Commands that answer questions in words and show the terms of the ontology."""
