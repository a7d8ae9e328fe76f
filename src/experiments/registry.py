"""The classes that a configuration may name in ``_target_``, and how they are built from it.

A configuration is data from a file: only what stands in ``ALLOWED`` is ever imported or called.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import Any

from experiments.errors import InputError

ALLOWED: frozenset[str] = frozenset(
    {
        # keep sorted; one dotted name a line
        "experiments.datasets.carotid.Carotid",
        "experiments.datasets.folder.Folder",
        "experiments.datasets.musv.MusV",
        "experiments.datasets.nnunet.NnUNet",
        "experiments.datasets.phantom.Phantom",
        "experiments.datasets.san_raffaele.SanRaffaele",
        "experiments.datasets.stand_in.StandIn",
        "experiments.datasets.usgra.Usgra",
        "experiments.group_splits.GroupSplits",
        "models.attention_unet.AttentionUNet",
        "models.augmentation.Affine",
        "models.augmentation.Augmentation",
        "models.augmentation.Brightness",
        "models.augmentation.Contrast",
        "models.augmentation.DepthGain",
        "models.augmentation.Elastic",
        "models.augmentation.Flip",
        "models.augmentation.Gamma",
        "models.augmentation.Speckle",
        "models.losses.DiceCrossEntropy",
        "models.losses.DiceFocal",
        "models.losses.Focal",
        "models.losses.Tversky",
        "models.monai_network.MonaiNetwork",
        "models.preprocessing.Preprocessing",
        "models.trainer_settings.TrainerSettings",
        "models.unet.UNet",
        "models.unet3plus.UNet3Plus",
        "registration.ambiguity.Judge",
        "registration.centerline.CenterlineExtractor",
        "registration.cloud_filters.RadiusOutlierRemoval",
        "registration.cloud_filters.StatisticalOutlierRemoval",
        "registration.cloud_filters.VoxelDownsampling",
        "registration.comparators.FpfhFastGlobal",
        "registration.comparators.FpfhFeatures",
        "registration.comparators.FpfhRansac",
        "registration.comparators.GeneralisedICP",
        "registration.comparators.KissMatcher",
        "registration.comparators.SingleStartICP",
        "registration.contours.ContourExtractor",
        "registration.label_surface.LabelSurface",
        "registration.line_detection.LineDetector",
        "registration.live.LiveRecorder",
        "registration.perturbation.Perturbation",
        "registration.phantom.acoustics.Artefacts",
        "registration.phantom.acoustics.Scanner",
        "registration.phantom.acoustics.Tissue",
        "registration.phantom.conditions.CtScan",
        "registration.phantom.conditions.Deformation",
        "registration.phantom.conditions.Motion",
        "registration.phantom.sessions.SessionVariation",
        "registration.phantom.settings.PhantomSettings",
        "registration.readers.detect.AutoReader",
        "registration.readers.folder.FolderReader",
        "registration.readers.plus.PlusReader",
        "registration.readers.rosbag.RosbagReader",
        "registration.rejection.DistanceRejection",
        "registration.rejection.NormalRejection",
        "registration.rejection.TrimRejection",
        "registration.rigid.MultiStartICP",
        "registration.robust_kernels.Huber",
        "registration.robust_kernels.Tukey",
        "registration.robust_kernels.Welsch",
        "registration.smoothing.TaubinSmoothing",
        "registration.spatial_calibration.NWireCalibration",
        "registration.stylus_calibration.PivotCalibration",
        "registration.surface.BallPivotingSurface",
        "registration.surface.PoissonSurface",
        "registration.surface_volume.SignedDistanceSurface",
        "registration.temporal_calibration.TemporalCalibration",
    }
)


def build(node: Any, where: str = "config") -> Any:
    """Replace every mapping with a ``_target_`` by the object it describes, depth first; all else stays as it is.

    ``where`` is the dotted place of ``node`` in the configuration, for messages. Raises InputError for a class that
    is not in ``ALLOWED``, for settings the class does not have, for missing ones, and for values it refuses.
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
    unknown = sorted(set(settings) - set(known))
    if unknown:
        raise InputError(
            f"{where}: expected settings of {cls.__name__} ({', '.join(known)}), received {', '.join(unknown)}"
        )
    missing = [
        name
        for name, parameter in known.items()
        if parameter.default is inspect.Parameter.empty and name not in settings
    ]
    if missing:
        raise InputError(
            f"{where}: expected a value for {', '.join(missing)} of {cls.__name__}, received none"
        )
    try:
        return cls(**settings)
    except (TypeError, ValueError) as refusal:
        raise InputError(f"{where}: {cls.__name__} refused its settings: {refusal}") from refusal
