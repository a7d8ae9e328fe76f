"""Ties between a network's channels: which must be permuted together so that its function is the same.

A hidden channel has no place of its own: the output channels of a convolution may be put in any order, if the
normalisation after it and the input channels of all layers that read it follow. Skips, concatenations, sums
and gates decide who reads whom. That is found by following one image through the network, not written down
for each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _NormBase
from torch.overrides import TorchFunctionMode

from models.averaging.channel_groups import ChannelGroups, Layout
from models.errors import InputError
from models.networks.registry import NetworkRecipe

# Modules and functions that process every channel independently and in the same way.
_CHANNELWISE_MODULES = (
    nn.Identity, nn.ReLU, nn.LeakyReLU, nn.ELU, nn.GELU, nn.SiLU, nn.Sigmoid, nn.Tanh, nn.Dropout, nn.Dropout2d,
    nn.MaxPool2d, nn.AvgPool2d, nn.Upsample, nn.ReplicationPad2d, nn.ConstantPad2d,
)  # fmt: skip
_CHANNELWISE_FUNCTIONS = frozenset({
    "add", "iadd", "radd", "mul", "imul", "rmul", "sub", "rsub", "neg", "relu", "leaky_relu", "sigmoid", "tanh",
    "max_pool2d", "avg_pool2d", "interpolate", "dropout", "dropout2d", "pad", "clone", "contiguous", "detach", "float",
    "to",
})  # fmt: skip
_NAMES = {"_max_pool2d": "max_pool2d", "add_": "add", "mul_": "mul", "sub_": "sub", "relu_": "relu"}


@dataclass(frozen=True, eq=False)
class ChannelTies:
    """Groups of channels, and the axes of tensors on which they lie.

    Parameters
    ----------
    blocks : mapping of int to ndarray
        For each group one label per channel: channels may change places where their labels are equal.
    axes : mapping of str to mapping of int to tuple of int
        For each tensor of the state dict that has channels, the groups on its axes.
    parameters : frozenset of str
        Names of the tensors that are trained; the others in ``axes`` are statistics.
    """

    blocks: Mapping[int, np.ndarray]
    axes: Mapping[str, Mapping[int, Layout]]
    parameters: frozenset[str]

    def size(self, group: int) -> int:
        """Count the channels of a group.

        Parameters
        ----------
        group : int
            Number of a group.

        Returns
        -------
        int
            Number of channels.
        """
        return len(self.blocks[group])

    @property
    def movable(self) -> tuple[int, ...]:
        """The groups of which at least two channels may change places."""
        return tuple(group for group, labels in self.blocks.items() if len(np.unique(labels)) < len(labels))


def channel_ties(recipe: NetworkRecipe) -> ChannelTies:
    """Find the ties of a network by following an image through it, in training mode for all its outputs.

    No memory is taken and no random number drawn: tensors have shapes alone.

    Parameters
    ----------
    recipe : NetworkRecipe
        Architecture of the network.

    Returns
    -------
    ChannelTies
        The ties of all channels.

    Raises
    ------
    InputError
        If the network does something whose effect on channels is not known here; the message names the
        operation.
    """
    with torch.random.fork_rng(devices=[]), torch.device("meta"):
        network = recipe().train()
        images = torch.zeros(2, 1, 2 * recipe.multiple, 2 * recipe.multiple)
    trace = _Trace(network)
    trace.place(images, trace.fixed(1))
    handles = [handle for module in _leaves(network) for handle in trace.attach(module)]
    try:
        with torch.no_grad(), trace:
            outputs = network(images)
    finally:
        for handle in handles:
            handle.remove()
    for output in _tensors(outputs):
        trace.fix(output)
    return trace.ties()


def _leaves(network: nn.Module) -> list[nn.Module]:
    return [module for module in network.modules() if not list(module.children())]


def _tensors(outputs: Any) -> Iterator[Tensor]:
    """All tensors in what a network returned."""
    if isinstance(outputs, Tensor):
        yield outputs
    elif dataclasses.is_dataclass(outputs):
        for each in dataclasses.fields(outputs):
            yield from _tensors(getattr(outputs, each.name))
    elif isinstance(outputs, (tuple, list)):
        for each in outputs:
            yield from _tensors(each)


class _Trace(TorchFunctionMode):
    """Follows channels through modules, by hooks, and through the functions called between them."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.groups = ChannelGroups()
        self.axes: dict[str, dict[int, Layout]] = {}
        self.network = network
        # One layer may have several names.
        self.names: dict[int, list[str]] = {}
        for name, tensor in network.state_dict(keep_vars=True).items():
            self.names.setdefault(id(tensor), []).append(name)
        # Tensors are kept, so that none takes another's id.
        self.layouts: dict[int, tuple[Tensor, Layout]] = {}
        self.inside = 0

    def fixed(self, size: int) -> Layout:
        """A new group of channels that keep their places."""
        group = self.groups.new(size)
        self.groups.restrict(group, np.arange(size))
        return (group,)

    def fix(self, output: Tensor) -> None:
        """Let the channels of a network's output keep their places."""
        for group in self.layouts[id(output)][1]:
            self.groups.restrict(group, np.arange(self.groups.sizes[group]))

    def place(self, tensor: Tensor, layout: Layout) -> None:
        self.layouts[id(tensor)] = (tensor, layout)

    def layout(self, tensor: Tensor, where: str) -> Layout:
        if id(tensor) not in self.layouts:
            raise InputError(
                f"network: expected what {where} reads to come from the image, found other input"
            )
        return self.layouts[id(tensor)][1]

    def attach(self, module: nn.Module) -> list[Any]:
        """Hooks that let functions inside a module pass unseen and lay out its result."""

        def enter(module: nn.Module, received: tuple[Any, ...]) -> None:
            self.inside += 1

        def leave(module: nn.Module, received: tuple[Any, ...], result: Tensor) -> None:
            self.inside -= 1
            self.place(result, self.through(module, self.layout(received[0], type(module).__name__)))

        return [module.register_forward_pre_hook(enter), module.register_forward_hook(leave)]

    def through(self, module: nn.Module, layout: Layout) -> Layout:
        """The layout of a module's result, from that of what it received."""
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)) and module.groups == 1:
            axis_in, axis_out = (1, 0) if isinstance(module, nn.Conv2d) else (0, 1)
            self.tie(module.weight, axis_in, layout)
            out = self.tie(module.weight, axis_out, (self.groups.new(module.out_channels),))
            return out if module.bias is None else self.tie(module.bias, 0, out)
        if isinstance(module, (_NormBase, nn.GroupNorm, nn.PReLU)):
            for tensor in (*module.parameters(), *module.buffers()):
                if tensor.ndim == 1 and not (isinstance(module, nn.PReLU) and module.num_parameters == 1):
                    self.tie(tensor, 0, layout)
            if isinstance(module, nn.GroupNorm):
                self._keep_within(layout, module.num_groups)
            return layout
        if isinstance(module, _CHANNELWISE_MODULES):
            return layout
        raise InputError(f"network: expected layers whose channels can be followed, found {module}")

    def tie(self, tensor: Tensor, axis: int, layout: Layout) -> Layout:
        """Record that a tensor of the state dict has these groups on an axis."""
        first, *others = self.names[id(tensor)]
        axes = self.axes.setdefault(first, {})
        if axis in axes:  # a layer that is used more than once
            self.groups.unite(axes[axis], layout, first)
        for name in others:
            self.axes[name] = axes
        return axes.setdefault(axis, layout)

    def _keep_within(self, layout: Layout, n_parts: int) -> None:
        """Channels that are normalised together stay together."""
        total = sum(self.groups.sizes[group] for group in layout)
        part = np.arange(total) // (total // n_parts)
        begin = 0
        for group in layout:
            self.groups.restrict(group, part[begin : begin + self.groups.sizes[group]])
            begin += self.groups.sizes[group]

    def __torch_function__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        result = func(*args, **(kwargs or {}))
        if not self.inside and isinstance(result, Tensor):
            received = [
                each for each in _tensors([*args, *(kwargs or {}).values()]) if id(each) in self.layouts
            ]
            if received:
                name = getattr(func, "__name__", str(func))
                self._between(_NAMES.get(name, name), received, result, (kwargs or {}).get("dim", args[1:2]))
        return result

    def _between(self, name: str, received: list[Tensor], result: Tensor, dim: Any) -> None:
        """Lay out the result of a function that was called between modules."""
        layouts = [self.layouts[id(tensor)][1] for tensor in received]
        if all(self._immovable(group) for layout in layouts for group in layout):
            self.place(result, self.fixed(result.shape[1] if result.ndim > 1 else 1))
        elif name in ("cat", "concat") and dim in (1, (1,)):
            self.place(result, tuple(group for layout in layouts for group in layout))
        elif name in _CHANNELWISE_FUNCTIONS and result.ndim == 4:
            # A single channel acts on all others alike.
            whole = [layout for layout in layouts if self._size(layout) == result.shape[1]]
            if not whole or any(self._size(layout) not in (1, result.shape[1]) for layout in layouts):
                raise InputError(
                    f"network: expected {name} to keep the number of channels, found another number"
                )
            for layout in whole[1:]:
                self.groups.unite(whole[0], layout, name)
            self.place(result, whole[0])
        else:
            raise InputError(f"network: expected operations whose channels can be followed, found {name}")

    def _size(self, layout: Layout) -> int:
        return sum(self.groups.sizes[group] for group in layout)

    def _immovable(self, group: int) -> bool:
        return len(np.unique(self.groups.blocks(group))) == self.groups.sizes[group]

    def ties(self) -> ChannelTies:
        """What was found; InputError for a tensor that no image passes."""
        state = self.network.state_dict()
        for name, tensor in state.items():
            followed = name in self.axes or tensor.numel() == 1
            if tensor.ndim and not followed:
                raise InputError(f"network: expected all weights to be used on an image, found {name} unused")
        axes = {
            name: {axis: tuple(self.groups.root(group) for group in layout) for axis, layout in found.items()}
            for name, found in self.axes.items()
        }
        roots = sorted({group for found in axes.values() for layout in found.values() for group in layout})
        parameters = frozenset(name for name, _ in self.network.named_parameters()) & axes.keys()
        return ChannelTies({group: self.groups.blocks(group) for group in roots}, axes, frozenset(parameters))
