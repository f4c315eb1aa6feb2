"""The text of machine.yaml: what YAML holds, with the line where it is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from pinotwin.errors import MachineError


class _Loader(yaml.SafeLoader):
    """SafeLoader that refuses a key given twice and keeps `y`, `no`, `on` as text: they may name axes."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            raise MachineError(f"line {line}: a key must be one word, not a list or a mapping")
        key = loader.construct_object(key_node, deep=True)
        key = "" if key is None else str(key)
        if key in seen:
            raise MachineError(f"line {line}: key {key!r} is given twice")
        seen[key] = loader.construct_object(value_node, deep=True)
    return seen


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:bool"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file; MachineError, with the line of a syntax error, where there is none."""
    if not path.is_file():
        raise MachineError(f"{path}: no such file; give a machine folder or its machine.yaml")
    try:
        content = _content(path)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}:" if mark is not None else ""
        problem = getattr(error, "problem", None) or "not valid YAML"
        raise MachineError(f"{path}:{line} {problem}") from None
    except UnicodeDecodeError:
        raise MachineError(f"{path}: not a text file in UTF-8; save it as one") from None
    except (ValueError, OverflowError) as error:  # a date that is none, a number of thousands of digits
        raise MachineError(f"{path}: {error}; correct this value") from None
    except RecursionError:
        raise MachineError(f"{path}: lists in lists without end; a machine has a few levels") from None
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror}; check its access") from None
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from None
    if not isinstance(content, dict):
        raise MachineError(f"{path}: expected keys such as name, urdf, axes at the top level")
    return content


def _content(path: Path, most: int = 10_000_000) -> Any:
    if path.stat().st_size > most:
        raise MachineError(f"is larger than {most} bytes; give a machine.yaml")
    loader = _Loader(path.read_text(encoding="utf-8-sig"))
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _size(node, {}, ())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _size(
    node: yaml.Node, known: dict[yaml.Node, int], above: tuple[yaml.Node, ...], most: int = 50_000
) -> int:
    """Return how many nodes there are once every alias is written out; refuse rings and floods."""
    if node in known:
        return known[node]
    if node in above:
        raise MachineError(f"line {node.start_mark.line + 1}: an alias that holds itself; write it out")
    parts = node.value if isinstance(node, yaml.CollectionNode) else []
    inner = [n for part in parts for n in (part if isinstance(part, tuple) else (part,))]
    size = 1 + sum(_size(n, known, (*above, node)) for n in inner)
    if size > most:
        raise MachineError(f"holds more than {most} entries, aliases written out; a machine has hundreds")
    known[node] = size
    return size
