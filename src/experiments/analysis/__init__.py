"""Tables, figures and findings that several studies share."""
