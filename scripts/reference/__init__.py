"""Pages of docs/reference, one module a page; `lines(root)` gives a page's lines, title first."""
