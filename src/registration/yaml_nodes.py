"""YAML that stays as small in memory as it is in its file.

An alias stands for what its anchor holds. Aliases of aliases of aliases are a few hundred bytes that stand for
thousands of millions of values: PyYAML keeps them as one object, but whatever goes over them, prints or copies them
takes every one. A node that holds itself never ends.
"""

from __future__ import annotations

from typing import Any

import yaml

from registration.errors import InputError

LARGEST_YAML_BYTES = 1 << 20
LARGEST_EXPANSION = 100_000


def load_yaml(text: str, loader: Any = yaml.SafeLoader) -> tuple[Any, yaml.Node | None]:
    """Parse YAML whose aliases stand for little.

    Parameters
    ----------
    text : str
        YAML.
    loader : type, optional
        Loader of PyYAML.

    Returns
    -------
    content : Any
        Its content.
    root : yaml.Node or None
        The node that it was made of; None for empty text.

    Raises
    ------
    InputError
        If aliases stand for too much, or the text is too long or nested too deep.
    yaml.YAMLError
        If the text does not parse.
    """
    if len(text) > LARGEST_YAML_BYTES:
        raise InputError(f"expected YAML of at most {LARGEST_YAML_BYTES} characters, received {len(text)}")
    reader = loader(text)
    try:
        root = reader.get_single_node()
        require_small(root)
        return None if root is None else reader.construct_document(root), root
    except RecursionError as failure:
        raise InputError("expected YAML of a few levels, received text that is nested too deep") from failure
    finally:
        reader.dispose()


def require_small(root: yaml.Node | None) -> None:
    """Raise InputError if the aliases under a node stand for too many values, or one for itself.

    Parameters
    ----------
    root : yaml.Node or None
        Node as PyYAML composes it.

    Raises
    ------
    InputError
        If there are more than ``LARGEST_EXPANSION`` values although the text has fewer.
    """
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()

    def size(node: yaml.Node) -> int:
        if id(node) in open_nodes:
            raise InputError("expected YAML without an alias of what it stands in, received one")
        if id(node) not in sizes:
            open_nodes.add(id(node))
            sizes[id(node)] = 1 + sum(map(size, _below(node)))
            open_nodes.discard(id(node))
        return sizes[id(node)]

    if root is not None and size(root) > max(LARGEST_EXPANSION, 2 * len(sizes)):
        raise InputError(
            f"expected YAML whose aliases stand for at most {LARGEST_EXPANSION} values, received {sizes[id(root)]}"
        )


def _below(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [each for pair in node.value for each in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []
