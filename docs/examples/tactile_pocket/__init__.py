"""The smallest plugin with one of everything; reference/hooks.md shows it, a test installs it."""
