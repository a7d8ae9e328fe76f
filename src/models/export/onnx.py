"""Networks as ONNX graphs, checked against the network they were made from.

A graph takes the images that ``models.preprocessing`` makes of frames. What comes after the networks (calibration,
thresholds, morphology) works on single images of their own size and is no part of it.
"""

from __future__ import annotations

import importlib
import io
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from models.array_types import Float32
from models.atomic import atomic_write
from models.errors import InputError

# The newest that the runtimes of the last years all read.
OPSET = 17
INPUT, OUTPUTS = "images", ("probability", "presence")
INSTALL = "pip install 'ctus[onnx]'"
# A larger difference of probability than this is no rounding.
MAX_DIFFERENCE = 1e-3


@dataclass(frozen=True)
class OnnxCheck:
    """How far a graph's outputs are from the network's on the same images.

    Parameters
    ----------
    max_difference : float
        Largest absolute difference of any output.
    images : int
        Number of images compared.
    bytes : int
        Size of the graph's file.
    """

    max_difference: float
    images: int
    bytes: int


def required(package: str) -> ModuleType:
    """Import a package that is needed for ONNX alone.

    Parameters
    ----------
    package : str
        ``onnx`` or ``onnxruntime``.

    Returns
    -------
    ModuleType
        The package.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as missing:
        raise InputError(f"onnx: expected the package {package}, found none ({INSTALL})") from missing


def onnx_graph(module: nn.Module, image_size_px: int) -> bytes:
    """Export a module that gives a tuple of tensors for a batch of images.

    Parameters
    ----------
    module : nn.Module
        Images (b, 1, s, s) to one or two tensors, named as ``OUTPUTS``; on the CPU.
    image_size_px : int
        Side s of the images in px; the number of images stays free.

    Returns
    -------
    bytes
        Content of an ``.onnx`` file.

    Raises
    ------
    InputError
        If the package onnx is not installed.
    """
    required("onnx")
    images = torch.zeros(2, 1, image_size_px, image_size_px)
    module.eval()
    with torch.inference_mode():
        outputs = OUTPUTS[: len(module(images))]
    graph = io.BytesIO()
    torch.onnx.register_custom_op_symbolic("aten::logaddexp", _logaddexp, OPSET)  # type: ignore[attr-defined]
    with warnings.catch_warnings(), torch.no_grad():
        # The exporter by tracing needs onnx alone; what it warns of is that sizes become constants, as they shall.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module,
            (images,),
            graph,  # type: ignore[arg-type] # the exporter by tracing writes to streams
            dynamo=False,
            input_names=[INPUT],
            output_names=list(outputs),
            dynamic_axes={name: {0: "batch"} for name in (INPUT, *outputs)},
            opset_version=OPSET,
        )
    return graph.getvalue()


def onnx_session(graph: bytes) -> Callable[[Float32[np.ndarray, "b 1 s s"]], list[np.ndarray]]:
    """Load a graph into ONNX Runtime, on as many threads as torch has.

    Parameters
    ----------
    graph : bytes
        Content of an ``.onnx`` file.

    Returns
    -------
    callable
        Images (b, 1, s, s) of float32 to the list of outputs.

    Raises
    ------
    InputError
        If the package onnxruntime is not installed.
    """
    runtime = required("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    # Threads that wait do not take the cores from others.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = runtime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    return lambda images: list(session.run(None, {INPUT: images}))


def export_onnx(
    module: nn.Module, image_size_px: int, path: Path, about: Mapping[str, str], seed: int = 0
) -> OnnxCheck:
    """Write a module as an ``.onnx`` file after its outputs have been compared on images of noise.

    Parameters
    ----------
    module : nn.Module
        Images (b, 1, s, s) to one or two tensors, named as ``OUTPUTS``; on the CPU.
    image_size_px : int
        Side s of the images in px.
    path : Path
        File to write.
    about : mapping of str to str
        Texts kept in the file's metadata.
    seed : int, optional
        Seed of the noise.

    Returns
    -------
    OnnxCheck
        The largest difference found.

    Raises
    ------
    InputError
        If a package is not installed, or an output differs by more than rounding.
    """
    graph = onnx_graph(module, image_size_px)
    rng = np.random.default_rng(seed)
    images = rng.normal(size=(3, 1, image_size_px, image_size_px)).astype(np.float32)
    difference = max_difference(module, onnx_session(graph), images)
    if not difference <= MAX_DIFFERENCE:
        raise InputError(
            f"{path}: expected a graph with the outputs of its network, found them {difference:.2g} apart"
        )
    onnx = required("onnx")
    model = onnx.load_model_from_string(graph)
    onnx.helper.set_model_props(model, dict(about))
    with atomic_write(path) as temporary:
        temporary.write_bytes(model.SerializeToString())
    return OnnxCheck(difference, len(images), path.stat().st_size)


def max_difference(
    module: nn.Module,
    other: Callable[[Float32[np.ndarray, "b 1 s s"]], list[np.ndarray]],
    images: Float32[np.ndarray, "b 1 s s"],
) -> float:
    """Find the largest difference between the outputs of a module and of another implementation of it.

    Parameters
    ----------
    module : nn.Module
        The module.
    other : callable
        Images to the list of outputs.
    images : ndarray of float32, shape (b, 1, s, s)
        Images.

    Returns
    -------
    float
        Largest absolute difference of any value of any output.
    """
    with torch.inference_mode():
        expected: tuple[Tensor, ...] = module(torch.tensor(images))
    received = other(images)
    return max(
        float(np.abs(one.numpy() - another).max()) for one, another in zip(expected, received, strict=True)
    )


def _logaddexp(graph: Any, one: Any, other: Any) -> Any:
    """The logarithm of a sum of exponentials, which ONNX has not: max + log(1 + exp(-|difference|))."""
    distance = graph.op("Neg", graph.op("Abs", graph.op("Sub", one, other)))
    return graph.op("Add", graph.op("Max", one, other), graph.op("Softplus", distance))
