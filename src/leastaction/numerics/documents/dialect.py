"""YAML as version 1.2 has it: ``yes`` and ``on`` are words, ``1e-3`` is a number, and no key stands twice.

PyYAML is imported by the first file that is read or written, so that to import the package stays quick.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

_NULL = re.compile(r"^(?:~|null|Null|NULL|)$")
_BOOL = re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$")
_INT = re.compile(r"^[-+]?[0-9]+$")
_FLOAT = re.compile(
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)

_DIGITS = list("-+0123456789")
_RESOLVERS = (
    ("tag:yaml.org,2002:null", _NULL, ["~", "n", "N", ""]),
    ("tag:yaml.org,2002:bool", _BOOL, list("tTfF")),
    ("tag:yaml.org,2002:int", _INT, _DIGITS),
    ("tag:yaml.org,2002:float", _FLOAT, [*_DIGITS, "."]),
)


@cache
def loader() -> Any:
    """Return the class that reads."""
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        """Reads plain data."""

        yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012 - PyYAML's own name

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            keys: set[str] = set()
            for key, _ in node.value:
                if not isinstance(key, yaml.ScalarNode):
                    raise yaml.constructor.ConstructorError(None, None, "a key is a list or a mapping", key.start_mark)
                if key.value in keys:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key.value!r} stands twice", key.start_mark
                    )
                keys.add(key.value)
            # A key is a name, whatever it looks like.
            return {key.value: self.construct_object(value, deep=deep) for key, value in node.value}

    Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
    Loader.add_constructor("tag:yaml.org,2002:int", lambda self, node: int(self.construct_scalar(node)))
    for tag, pattern, first in _RESOLVERS:
        Loader.add_implicit_resolver(tag, pattern, first)
    return Loader


def _mapping(self: Any, node: Any) -> Any:
    data: dict[Any, Any] = {}
    yield data
    data.update(self.construct_mapping(node))


@cache
def dumper() -> Any:
    """Return the class that writes."""
    import yaml

    class Dumper(yaml.SafeDumper):  # type: ignore[misc]
        """Writes plain data, no aliases, and quotes what would be read as something else."""

        yaml_implicit_resolvers: dict[Any, Any] = {}  # noqa: RUF012 - PyYAML's own name

        def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - PyYAML's interface
            return True

        def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:  # noqa: ARG002
            super().increase_indent(flow, False)  # lists stand to the right of their key

    for tag, pattern, first in _RESOLVERS:
        Dumper.add_implicit_resolver(tag, pattern, first)
    return Dumper
