"""Type stubs of ``chemage`` in which the factories know the kinds and options of every installed component.

Editors and type checkers then complete and check ``chemage.contact("fft-bem", ...)``. The stubs that come with chemage,
``chemage/__init__.pyi`` and ``chemage/plugin.pyi``, are made so from the plugins that come with it; ``chemage plugins
stubs`` makes some that know other plugins as well.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from typing import Any

from chemage.foundation.errors import PluginError
from chemage.foundation.names import FACTORIES, HOME, MODULES, USERS
from chemage.plugins import registry

_MADE = "# Made by `chemage plugins stubs`; do not edit.\n"
_HEAD = f"""{_MADE}from collections.abc import Sequence
from typing import Any, Literal, overload

from chemage.foundation.units import QuantityLike
from chemage.foundation.version import __version__ as __version__
"""


def stubs(distribution: str | None = None) -> dict[str, str]:
    """File -> text of the stubs of ``chemage``: every public name, and of the factories an overload for each kind.

    Only plugins of ``distribution`` are included, if it is given. A kind that the stub does not know is an error to a
    type checker; use its class, or make a stub of your own.
    """
    authors = {*HOME, *MODULES} - USERS
    return {"__init__.pyi": _users_stub(distribution), "plugin.pyi": "".join([_MADE, *_imports(authors)])}


def _imports(names: Iterable[str]) -> Iterable[str]:
    for name in sorted(names):
        module, _, last = f"chemage.{MODULES[name] if name in MODULES else f'{HOME[name]}.{name}'}".rpartition(".")
        yield f"from {module} import {last} as {name}\n"


def _users_stub(distribution: str | None) -> str:
    plugins = registry.current()
    factories = {role: name for role in plugins.roles if (name := FACTORIES.get(role, role)) in HOME}
    returned = {plugins.role(role).__name__ for role in factories}
    lines = [_HEAD, *_imports(USERS - set(factories.values()))]
    lines += [f"from chemage.{HOME[name]} import {name}\n" for name in sorted(returned)]
    for role, factory in factories.items():
        base = plugins.role(role).__name__
        kinds = [kind for kind in plugins.kinds(role) if _is_of(distribution, role, kind)]
        for kind in kinds:
            try:
                options = list(_options(plugins.component(role, kind)))
            except PluginError as error:
                warnings.warn(f"not in the stubs: {error}", registry.PluginWarning, stacklevel=2)
                continue
            arguments = f", *, {', '.join(options)}" if options else ""
            lines.append(f'\n@overload\ndef {factory}(kind: Literal["{kind}"]{arguments}) -> {base}: ...')
        if len(kinds) == 1:  # one overload is none
            lines[-1] = lines[-1].replace("@overload\n", "")
        lines.append("\n")
    return "".join(lines)


def _is_of(distribution: str | None, role: str, kind: str) -> bool:
    return distribution is None or any(
        record.distribution == distribution for record in registry.current().offers(role, kind)
    )


def _options(cls: Any) -> Iterable[str]:
    """``name: type`` or ``name: type = ...`` of each option."""
    properties = cls.model_json_schema(mode="validation").get("properties", {})
    for name, info in cls.model_fields.items():
        yield f"{name}: {_type(properties.get(name, {}))}" + ("" if info.is_required() else " = ...")


def _type(schema: Mapping[str, Any]) -> str:
    """A JSON Schema as a Python type; what is not plain is Any."""
    if "unit" in schema:
        further = [_type(part) for part in schema.get("anyOf", ()) if part.get("type") not in ("number", "string")]
        return " | ".join(dict.fromkeys(["QuantityLike", *further]))
    if "enum" in schema or "const" in schema:
        return f"Literal[{', '.join(repr(value) for value in schema.get('enum', [schema.get('const')]))}]"
    if "anyOf" in schema:
        parts = list(dict.fromkeys(_type(part) for part in schema["anyOf"]))
        return "Any" if "Any" in parts else " | ".join(part for part in parts if part != "int" or "float" not in parts)
    if schema.get("type") == "array":
        return f"Sequence[{_type(schema.get('items', {})) if isinstance(schema.get('items'), dict) else 'Any'}]"
    names = {"number": "float", "integer": "int", "string": "str", "boolean": "bool", "null": "None"}
    names["object"] = "dict[str, Any]"
    return names.get(schema.get("type", ""), "Any")
