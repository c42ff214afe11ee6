"""Commands on ontologies and reasoning."""
