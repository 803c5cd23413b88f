"""A plugin for sweeps: a sensor of twenty pixels, and a model that can kill its process."""
