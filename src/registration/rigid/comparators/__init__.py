"""Rigid methods that multi-start registration is compared with, behind the same call."""

from registration.rigid.comparators.fpfh import FpfhFastGlobal, FpfhRansac
from registration.rigid.comparators.fpfh_features import FpfhFeatures
from registration.rigid.comparators.gicp import GeneralisedICP
from registration.rigid.comparators.kiss_matcher import KissMatcher
from registration.rigid.comparators.rigid_point_drift import RigidPointDrift
from registration.rigid.comparators.single_icp import SingleStartICP

__all__ = [
    "FpfhFastGlobal",
    "FpfhFeatures",
    "FpfhRansac",
    "GeneralisedICP",
    "KissMatcher",
    "RigidPointDrift",
    "SingleStartICP",
]
