"""Strict YAML: 1e-12 is a number, 010 is ten, on and off are words, and a repeated key is an error."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from textile_twin_core.errors import TwinError

_NUMBER = re.compile(
    r"[-+]?(\d[\d_]*\.?[\d_]*([eE][-+]?\d+)?|\.\d[\d_]*([eE][-+]?\d+)?|\.(inf|Inf|INF)|\.(nan|NaN|NAN))$"
)
_INTEGER = re.compile(r"[-+]?(\d[\d_]*|0x[0-9a-fA-F]+|0o[0-7]+)$")
_BOOLEAN = re.compile(r"(true|True|TRUE|false|False|FALSE)$")


_SURPRISING = ("bool", "int", "float", "timestamp")


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2 in place of surprising ones of YAML 1.1."""


_Loader.yaml_implicit_resolvers = {
    letter: [(tag, pattern) for tag, pattern in resolvers if tag.rpartition(":")[2] not in _SURPRISING]
    for letter, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", _BOOLEAN, list("tTfF"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _INTEGER, list("-+0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, list("-+0123456789."))


def _integer(loader: _Loader, node: yaml.ScalarNode) -> int:
    text = loader.construct_scalar(node).replace("_", "")
    return int(text, 0 if "x" in text or "o" in text else 10)


_Loader.add_constructor("tag:yaml.org,2002:int", _integer)


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys: set[str] = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise yaml.constructor.ConstructorError(None, None, "a key must be a word", key.start_mark)
        if key.value in keys:
            raise yaml.constructor.ConstructorError(None, None, f"'{key.value}' is given twice", key.start_mark)
        keys.add(key.value)
    loader.flatten_mapping(node)
    mapping: dict[Any, Any] = loader.construct_mapping(node, deep=True)
    return mapping


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)


def read_yaml(path: Path, error: type[TwinError]) -> Any:
    """Read the document in a file. Raises `error` with the line if it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise error(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as failure:
        raise error(f"{path}: cannot be read as text ({getattr(failure, 'strerror', None) or failure})") from failure
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as failure:
        mark = failure.problem_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise error(f"{path}{where}: {failure.problem}") from failure
    except RecursionError as failure:
        raise error(f"{path}: lists or mappings are nested too deeply") from failure
    except (yaml.YAMLError, ValueError) as failure:  # ValueError: a number of thousands of digits
        raise error(f"{path}: not YAML: {str(failure).splitlines()[0]}") from failure
