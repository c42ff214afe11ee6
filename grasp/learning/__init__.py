"""Learning which grasp to try: beliefs over candidates, fed by the outcomes of all robots."""
