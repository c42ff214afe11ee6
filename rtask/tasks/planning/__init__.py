"""Plans without a store: actions, facts, a forward search, and reasons why there is no plan.

Facts are :data:`~rtask.tasks.planning.problem.Atom` tuples; nothing here reads the graph, so that
the search can be tried, measured and compared on its own.
"""
