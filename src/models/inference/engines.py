"""What runs the networks: torch itself, torch's compiler, ONNX Runtime or OpenVINO."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from models.errors import InputError
from models.export.onnx import onnx_graph, onnx_session
from models.inference.ensemble import MeanProbability

# Images (b, 1, s, s) to the outputs of MeanProbability. The alias is made where jaxtyping may be missing.
Forward = Callable[[Tensor], Sequence[Tensor]]

ENGINES = ("auto", "eager", "compiled", "onnxruntime", "openvino")
PACKAGES = {"onnxruntime": ("onnx", "onnxruntime"), "openvino": ("onnx", "openvino")}
# The fastest on a CPU that gives torch's probabilities to 1e-5 (scripts/bench_inference.py), where it is installed.
FASTEST = ("openvino", "onnxruntime")


def require_engine(engine: str) -> None:
    """Check that an engine is known.

    Parameters
    ----------
    engine : str
        One of ``ENGINES``.

    Raises
    ------
    InputError
        If it is none.
    """
    if engine not in ENGINES:
        raise InputError(f"engine: expected one of {', '.join(ENGINES)}, received {engine!r}")


def chosen_engine(engine: str, device: str) -> str:
    """Tell which engine ``auto`` stands for.

    Parameters
    ----------
    engine : str
        One of ``ENGINES``.
    device : str
        ``cpu`` or ``cuda``.

    Returns
    -------
    str
        The engine; for ``auto`` the fastest that is installed, on a GPU ``eager``.

    Raises
    ------
    InputError
        If the engine is unknown.
    """
    require_engine(engine)
    if engine != "auto":
        return engine
    found = [name for name in FASTEST if device == "cpu" and is_installed(name)]
    return found[0] if found else "eager"


def forward_of(ensemble: MeanProbability, engine: str, image_size_px: int, device: str) -> Forward:
    """Prepare networks for use.

    Parameters
    ----------
    ensemble : MeanProbability
        The networks, on the device.
    engine : str
        One of ``ENGINES``.
    image_size_px : int
        Side of the images in px.
    device : str
        ``cpu`` or ``cuda``.

    Returns
    -------
    callable
        Images (b, 1, s, s) to the outputs of ``ensemble``.

    Raises
    ------
    InputError
        If the engine is unknown, not installed, or not for this device.
    """
    ensemble.eval()
    chosen = chosen_engine(engine, device)
    if chosen == "eager":
        return ensemble
    if chosen == "compiled":
        compiled: Forward = torch.compile(ensemble)
        return compiled
    if device != "cpu":
        raise InputError(f"engine: expected eager or compiled for device {device}, received {chosen}")
    if not is_installed(chosen):
        packages = " and ".join(PACKAGES[chosen])
        extra = "openvino" if chosen == "openvino" else "onnx"
        raise InputError(
            f"engine: expected the packages {packages} for {chosen}, found not both (pip install 'ctus[{extra}]')"
        )
    graph = onnx_graph(ensemble, image_size_px)
    run = onnx_session(graph) if chosen == "onnxruntime" else _openvino(graph)
    return lambda images: [torch.from_numpy(output) for output in run(images.contiguous().numpy())]


def is_installed(engine: str) -> bool:
    """Tell whether the packages of an engine are there.

    Parameters
    ----------
    engine : str
        One of ``PACKAGES``.

    Returns
    -------
    bool
        True if all of them are.
    """
    return all(importlib.util.find_spec(package) is not None for package in PACKAGES[engine])


def _openvino(graph: bytes) -> Callable:
    import openvino

    core = openvino.Core()
    settings = {
        "INFERENCE_NUM_THREADS": torch.get_num_threads(),
        "PERFORMANCE_HINT": "LATENCY",
        # Without this a CPU with 16-bit units computes in 16 bits.
        "INFERENCE_PRECISION_HINT": "f32",
    }
    compiled = core.compile_model(core.read_model(graph, b""), "CPU", settings)
    return lambda images: list(compiled(images).to_tuple())
