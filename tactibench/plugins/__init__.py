"""Hook specifications, specs, base classes and the guarded plugin host."""
