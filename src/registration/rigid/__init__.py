"""Symmetry-aware multi-start ICP."""

from registration.rigid.multi_start import KEPT, REFINEMENTS, MultiStartICP

__all__ = ["KEPT", "REFINEMENTS", "MultiStartICP"]
