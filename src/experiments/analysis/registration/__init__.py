"""Tables, figures and findings of registration."""
