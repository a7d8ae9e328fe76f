"""Configurations in, tracked results out: the studies, the tracker, and the command line around them."""
