"""A plugin that looks for the truth of the test frames wherever a plugin can look."""
