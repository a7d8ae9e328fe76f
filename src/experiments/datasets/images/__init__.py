"""Images and masks of data sets: decoded by meaning, compared, and measured."""
