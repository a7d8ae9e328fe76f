"""Deformable registration after a rigid one: the displacement of tissue as a function of place, and its error."""
