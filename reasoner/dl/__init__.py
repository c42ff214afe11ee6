"""OWL 2 beyond the RL profile: the profile check and the description logic reasoners."""
