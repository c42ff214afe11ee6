"""The agent: look, ask the graph, grasp, judge, report."""
