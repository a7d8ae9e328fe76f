"""Symmetry-aware multi-start ICP."""

from registration.rigid.multi_start import KEPT, REFINEMENTS, SMOOTHING, MultiStartICP

__all__ = ["KEPT", "REFINEMENTS", "SMOOTHING", "MultiStartICP"]
