"""Tables, figures and findings of segmentation."""
