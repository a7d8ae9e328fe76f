"""Who trains and who is scored: partitions by group."""
