"""Pictures: one module for each figure, with a function that draws it for PNG and pages."""
