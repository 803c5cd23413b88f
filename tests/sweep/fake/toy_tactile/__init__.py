"""A plugin for sweeps: a sensor of twelve pixels, and a model that can kill its process."""
