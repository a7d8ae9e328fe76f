"""Tables, figures and findings of the frozen benchmark of rigid registration."""
