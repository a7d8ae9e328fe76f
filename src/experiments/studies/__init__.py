"""Studies: what can be run, one module or package each."""
