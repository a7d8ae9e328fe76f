"""Values published by others, computed again."""
