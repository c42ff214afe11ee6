"""SPARQL 1.1 Protocol and Service Description, request in and response out."""
