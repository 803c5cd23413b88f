"""How fast a model is, and on what machine that was measured."""
