"""A model in use: frames as they come, the networks as one module, and what runs it."""
