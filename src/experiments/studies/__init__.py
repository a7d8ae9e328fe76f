"""Studies: one function each, from settings to an outcome."""
