"""The words of a call: options, presets, names that stay text, and the help page."""
