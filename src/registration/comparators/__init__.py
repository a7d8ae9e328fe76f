"""Rigid methods that multi-start registration is compared with, behind the same call."""

from registration.comparators.feature_matching import FpfhFastGlobal, FpfhRansac
from registration.comparators.features import FpfhFeatures
from registration.comparators.generalised import GeneralisedICP
from registration.comparators.kiss import KissMatcher
from registration.comparators.single_start import SingleStartICP

__all__ = ["FpfhFastGlobal", "FpfhFeatures", "FpfhRansac", "GeneralisedICP", "KissMatcher", "SingleStartICP"]
