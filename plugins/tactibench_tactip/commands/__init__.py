"""The verbs of `tactibench hw`."""
