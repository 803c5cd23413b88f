"""Pages of docs/reference, one module a page; `lines(root)` returns its lines, title first."""
