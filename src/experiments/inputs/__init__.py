"""Files of the user that settings name."""
