"""How often random goals are reached by robots that plan, act, and plan again."""
