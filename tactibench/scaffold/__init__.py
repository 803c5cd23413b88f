"""A new plugin as an installable package, from the templates beside this file."""
