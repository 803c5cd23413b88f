"""Writers of tables: one format a module, each a function from a table to text."""
