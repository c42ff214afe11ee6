"""Terms, their fixed vocabulary, their ids and their values."""
