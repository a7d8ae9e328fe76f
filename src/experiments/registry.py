"""The classes that a configuration may name in ``_target_``, and how they are built from it.

A configuration is data from a file: only what stands in ``ALLOWED`` is ever imported or called.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import Any

from experiments.errors import InputError, did_you_mean
from models.errors import InputError as ModelsInputError
from models.value_types import require_settings

ALLOWED: frozenset[str] = frozenset(
    {
        # keep sorted; one dotted name a line
        "experiments.datasets.carotid.Carotid",
        "experiments.datasets.folder.Folder",
        "experiments.datasets.musv.MusV",
        "experiments.datasets.nnunet.NnUNet",
        "experiments.datasets.phantom.Phantom",
        "experiments.datasets.san_raffaele.SanRaffaele",
        "experiments.datasets.simulated.StandIn",
        "experiments.datasets.usgra.Usgra",
        "experiments.splits.group_splits.GroupSplits",
        "models.networks.attention_unet.AttentionUNet",
        "models.training.augmentation.Augmentation",
        "models.training.losses.DiceCrossEntropy",
        "models.training.losses.DiceFocal",
        "models.training.losses.Focal",
        "models.training.losses.Tversky",
        "models.networks.monai_network.MonaiNetwork",
        "models.preprocessing.Preprocessing",
        "models.training.settings.TrainerSettings",
        "models.networks.unet.UNet",
        "models.networks.unet3plus.UNet3Plus",
        "registration.rigid.acceptance.AcceptanceCriteria",
        "registration.centerline.CenterlineExtractor",
        "registration.reconstruction.outlier_filters.RadiusOutlierRemoval",
        "registration.reconstruction.outlier_filters.StatisticalOutlierRemoval",
        "registration.reconstruction.outlier_filters.VoxelDownsampling",
        "registration.rigid.comparators.FpfhFastGlobal",
        "registration.rigid.comparators.FpfhFeatures",
        "registration.rigid.comparators.FpfhRansac",
        "registration.rigid.comparators.GeneralisedICP",
        "registration.rigid.comparators.KissMatcher",
        "registration.rigid.comparators.SingleStartICP",
        "registration.reconstruction.contours.ContourExtractor",
        "registration.ct_model.label_surface.LabelSurface",
        "registration.calibration.line_detection.LineDetector",
        "registration.readers.live.LiveRecorder",
        "registration.reconstruction.mask_outliers.MaskOutliers",
        "registration.perturbation.Perturbation",
        "registration.phantom.acoustics.Artefacts",
        "registration.phantom.acoustics.Scanner",
        "registration.phantom.acoustics.Tissue",
        "registration.phantom.conditions.CtScan",
        "registration.phantom.conditions.Deformation",
        "registration.phantom.conditions.Motion",
        "registration.phantom.session_variation.SessionVariation",
        "registration.phantom.settings.PhantomSettings",
        "registration.readers.auto.AutoReader",
        "registration.readers.folder.FolderReader",
        "registration.readers.plus.PlusReader",
        "registration.readers.rosbag.RosbagReader",
        "registration.rigid.icp.rejection.DistanceRejection",
        "registration.rigid.icp.rejection.NormalRejection",
        "registration.rigid.icp.rejection.TrimRejection",
        "registration.rigid.MultiStartICP",
        "registration.rigid.correspondence.Correspondence",
        "registration.rigid.search_cone.SearchBound",
        "registration.rigid.stages.Stages",
        "registration.rigid.starts.Starts",
        "registration.rigid.uncertainty.Uncertainty",
        "registration.rigid.icp.robust_kernels.Huber",
        "registration.rigid.icp.robust_kernels.Tukey",
        "registration.rigid.icp.robust_kernels.Welsch",
        "registration.reconstruction.taubin.TaubinSmoothing",
        "registration.calibration.spatial.NWireCalibration",
        "registration.calibration.stylus.PivotCalibration",
        "registration.reconstruction.surface.BallPivotingSurface",
        "registration.reconstruction.surface.PoissonSurface",
        "registration.reconstruction.signed_distance.SignedDistanceSurface",
        "registration.calibration.temporal.TemporalCalibration",
        "registration.reconstruction.vessel_pieces.VesselPieces",
    }
)


def build(node: Any, where: str = "config") -> Any:
    """Replace every mapping with a ``_target_`` by the object it describes, depth first; all else stays as it is.

    ``where`` is the dotted place of ``node`` in the configuration, for messages. Raises InputError for a class that
    is not in ``ALLOWED``, for settings the class does not have, for missing ones, for values of another type than the
    class says, and for those it refuses.
    """
    if isinstance(node, Mapping):
        built = {key: build(value, f"{where}.{key}") for key, value in node.items() if key != "_target_"}
        return _construct(str(node["_target_"]), built, where) if "_target_" in node else built
    if isinstance(node, (list, tuple)):
        return [build(value, f"{where}[{index}]") for index, value in enumerate(node)]
    return node


def load(target: str, where: str = "config") -> type:
    """Import the class named ``target`` if it is allowed."""
    if target not in ALLOWED:
        raise InputError(
            f"{where}._target_: expected a class of this project's registry, received {target!r}; "
            f"registered are {', '.join(sorted(ALLOWED))}"
        )
    module, _, name = target.rpartition(".")
    loaded: type = getattr(importlib.import_module(module), name)
    return loaded


def _construct(target: str, settings: dict[str, Any], where: str) -> Any:
    cls = load(target, where)
    known = inspect.signature(cls).parameters
    hint = next((did_you_mean(name, known) for name in sorted(set(settings) - set(known))), "")
    try:
        require_settings(cls, settings, where)
    except ModelsInputError as refusal:
        raise InputError(f"{refusal}{hint}") from refusal
    try:
        return cls(**settings)
    except (TypeError, ValueError) as refusal:
        raise InputError(f"{where}: {cls.__name__} refused its settings: {refusal}") from refusal
