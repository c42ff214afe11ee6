"""The change feed: commits in order, subscriptions, live queries and history."""
