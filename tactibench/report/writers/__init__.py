"""Writers of tables: one module for each format, with a function from a table to text."""
