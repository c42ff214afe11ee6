"""Tools for agents: the graph asked by programs that know nothing but the texts of the tools.

Texts that robots or people stored are data: they stand only in members of type ``text``, with who
wrote them, and never in a description, an instruction or the words of an error.
"""
