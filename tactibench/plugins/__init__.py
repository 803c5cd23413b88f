"""Hook specifications, specs, interfaces and the guarded plugin host."""
