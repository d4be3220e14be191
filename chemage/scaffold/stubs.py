"""Type stubs of ``chemage`` in which the factories know the kinds and options of every installed component.

Editors and type checkers then complete and check ``chemage.contact("fft-bem", ...)``. The stub that comes with chemage,
``chemage/__init__.pyi``, is made so from the plugins that come with it; ``chemage plugins stubs`` makes one that knows
other plugins as well.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from typing import Any

from chemage.foundation.errors import PluginError
from chemage.foundation.names import FACTORIES, HOME, MODULES
from chemage.plugins import registry

_HEAD = """# Made by `chemage plugins stubs`; do not edit.
from collections.abc import Sequence
from typing import Any, Literal, overload

from chemage.foundation.units import QuantityLike
"""


def stub_text(distribution: str | None = None) -> str:
    """The stub: every public name, and for each kind an overload of the factory of its role.

    Only plugins of ``distribution`` are included, if it is given. A kind that the stub does not know is an error to a
    type checker; use its class, or make a stub of your own.
    """
    plugins = registry.current()
    factories = {role: name for role in plugins.roles if (name := FACTORIES.get(role, role)) in HOME}
    lines = [_HEAD]
    for name in sorted({*HOME, "__version__"} - set(factories.values())):
        home = "foundation.version" if name == "__version__" else HOME[name]
        lines.append(f"from chemage.{home} import {name} as {name}\n")
    for name, module in sorted(MODULES.items()):
        package, _, last = module.rpartition(".")
        lines.append(f"from chemage{'.' * bool(package)}{package} import {last} as {name}\n")
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
