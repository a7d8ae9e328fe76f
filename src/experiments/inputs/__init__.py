"""A user's own files, named by settings."""
