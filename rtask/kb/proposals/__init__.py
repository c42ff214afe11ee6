"""Changes kept without effect until somebody decides; see :mod:`rtask.kb.proposals.register`."""
