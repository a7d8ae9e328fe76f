"""Pages of results/: Markdown, tables and figures made from what a study measured."""
