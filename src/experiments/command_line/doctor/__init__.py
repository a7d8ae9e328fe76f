"""``ctus doctor``: what this machine has, what is missing, and the line that installs it."""
