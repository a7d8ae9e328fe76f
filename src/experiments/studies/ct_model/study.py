"""Study ``ct_model``: the preoperative side, from a label map or a mesh of the user's to surface and centerline."""

from __future__ import annotations

import json
from pathlib import Path

from experiments import files
from experiments.errors import InputError
from experiments.outcome import InputData, Outcome, Progress
from experiments.paths import PathSetting
from experiments.reporting.scene import LineLayer, Scene, SurfaceLayer
from experiments.studies.ct_model.notes import remarks
from experiments.studies.ct_model.report import CtModel, metrics, record, table
from registration.centerline.extractor import CenterlineExtractor
from registration.ct_model.label_surface import LabelSurface
from registration.ct_model.loader import check_model, read_model
from registration.errors import InputError as RegistrationInputError
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.shapes import Centerline, Mesh
from registration.io.centerlines import write_centerline
from registration.io.patient_space import write_model
from registration.pipeline import timed

WHERE = "surface.ply and surface.stl hold the model in mm in LPS; open scene.html in a browser to look at it."
LPS_NOTE = "LPS: x points to the patient's left, y to the back, z to the head."


def check(
    *,
    input: PathSetting,
    label: int | str | None,
    space: str | None,
    units: str | None,
    nifti_form: str | None = None,
) -> None:
    """Check that the file is of a known kind and that the settings exist.

    Parameters
    ----------
    input : PathSetting
        File of a label map or of a surface.
    label : int or str or None
        Value of the vessel's label, or the name of its segment; None for the only one there is.
    space : str or None
        Axes of the file in the patient, lps or ras; None to take them from the file.
    units : str or None
        Length unit: mm, cm or m; None for what the header says, else mm.
    nifti_form : str or None, optional
        qform or sform: which transform counts where the two of a NIfTI file differ; None for neither.

    Raises
    ------
    InputError
        If the file does not exist or is of no known kind, or a setting does not exist.
    """
    check_model(_path(input), _label(label), space, units, nifti_form)


def run(
    *,
    input: PathSetting,
    label: int | str | None,
    space: str | None,
    units: str | None,
    nifti_form: str | None = None,
    label_surface: LabelSurface,
    centerline: CenterlineExtractor,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Make the model of a vessel in mm in LPS.

    Leaves ``surface.ply`` and ``.stl``, ``centerline.vtp``, ``.csv`` and ``.mrk.json``, ``ct_model.json`` and
    ``scene.html`` in ``workspace``. A surface that has no centerline is kept, and the reason given.

    Parameters
    ----------
    input : PathSetting
        File of a label map or of a surface.
    label : int or str or None
        Value of the vessel's label, or the name of its segment; None for the only one there is.
    space : str or None
        Axes of the file in the patient, lps or ras; None to take them from the file.
    units : str or None
        Length unit: mm, cm or m; None for what the header says, else mm.
    nifti_form : str or None, optional
        qform or sform: which transform counts where the two of a NIfTI file differ; None for neither.
    label_surface : LabelSurface
        Method that makes a surface of a label map.
    centerline : CenterlineExtractor
        Extraction of the centerline.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, the table and findings.

    Raises
    ------
    InputError
        If the file is no model of a vessel.
    """
    path = _path(input)
    timing: dict[str, float] = {}
    progress.note(f"reading {path.name}")
    with timed(timing, "surface_s"):
        source = read_model(path, label_surface, _label(label), space, units, nifti_form)
    progress.note(f"centerline of {len(source.mesh.triangles)} triangles")
    with timed(timing, "centerline_s"):
        lines, refusal = _centerline(source.mesh, centerline)
    with timed(timing, "quality_s"):
        quality = mesh_quality(source.mesh)
    model = CtModel(path, source, lines, refusal, quality, timing)
    with timed(timing, "files_s"):
        for suffix in ("ply", "stl"):
            write_model(workspace / f"surface.{suffix}", source.mesh, "lps")
        if lines is not None:
            for suffix in ("vtp", "csv", "mrk.json"):
                write_centerline(workspace / f"centerline.{suffix}", lines, "LPS")
        _scene(model).write(workspace / "scene.html")
    files.write_text(workspace / "ct_model.json", json.dumps(record(model), indent=2, allow_nan=False) + "\n")
    return Outcome(
        metrics=metrics(model),
        tables={"ct_model": table(model)},
        findings=(*remarks(model), WHERE),
        inputs=(InputData(path.name, files.digest(path), str(path)),),
    )


def _path(value: str) -> Path:
    if not value:
        raise InputError("input: expected the file of a label map or a mesh, received none")
    return Path(value)


def _label(value: object) -> int | str | None:
    if value is None or (isinstance(value, str) and value):
        return value
    if isinstance(value, bool) or not isinstance(value, int) or value == 0:
        raise InputError(
            "label: expected a whole number other than 0, the background, or the name of a segment, "
            f"received {value!r}"
        )
    return value


def _centerline(mesh: Mesh, extract: CenterlineExtractor) -> tuple[Centerline | None, str]:
    """The centerline, or none and why."""
    try:
        return extract(mesh), ""
    except RegistrationInputError as refusal:
        return None, str(refusal)


def _scene(model: CtModel) -> Scene:
    layers = [SurfaceLayer("surface", model.source.mesh)]
    lines = [] if model.centerline is None else [LineLayer.of("centerline", model.centerline)]
    return Scene([*layers, *lines], f"CT model of {model.path.name}", (LPS_NOTE, *remarks(model)))
