"""Search for antipodal hand poses on partial clouds (ten Pas and Platt 2015)."""
