"""Pictures: one module a figure, each a function from data to a figure, for PNG and for pages."""
