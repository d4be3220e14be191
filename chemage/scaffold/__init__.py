"""What authors of plugins are given: the folder of a working plugin with tests of its role, and stubs for editors.

In the stubs the factories know the kinds and options of every installed component, so that editors and type checkers
complete and check ``chemage.contact("fft-bem", ...)``. Those that come with chemage, ``chemage/__init__.pyi`` and
``chemage/plugin.pyi``, are made so from the plugins that come with it; ``chemage plugins stubs`` makes some that know
other plugins as well.
"""

from __future__ import annotations

import keyword
import re
import warnings
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from chemage.foundation.errors import InputError, PluginError, StoreError, nearest
from chemage.foundation.files import create
from chemage.foundation.names import FACTORIES, HOME, MODULES, USERS, __version__
from chemage.plugins import registry
from chemage.plugins.hooks import API_VERSION


def new(name: str, role: str, folder: Path) -> list[Path]:
    """Write a plugin with a component of kind ``name`` for ``role`` into ``folder``/chemage-``name``.

    Returns
    -------
    list of pathlib.Path
        The files, the first of which is ``pyproject.toml``.

    Raises
    ------
    InputError
        ``name`` is not valid for a kind, or there is no such role.
    StoreError
        The folder exists or cannot be created.
    """
    # those of plugins have no template
    roles = [
        role
        for role, target in registry.current().roles.items()
        if target.startswith("chemage.")
    ]
    if role not in roles:
        raise InputError(
            f"no role {role!r}{nearest(role, roles)}; the roles are {', '.join(roles)}"
        )
    module = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) or keyword.iskeyword(
        module
    ):
        raise InputError.of(
            "name",
            name,
            "is not a valid kind",
            "use lower-case words joined by -, such as my-barriers",
        )
    package = f"chemage_{module}"
    words = {
        "kind": name,
        "role": role,
        "module": module,
        "package": package,
        "distribution": f"chemage-{name}",
        "api": API_VERSION,
        "versions": version_range(),
        "cls": "".join(part.capitalize() for part in name.split("-")),
    }
    _warn_if_taken(name, role, package)
    contents = {
        Path("pyproject.toml"): "pyproject.toml",
        Path("README.md"): "README.md",
        Path(package, "__init__.py"): "package.py",
        Path(package, f"{module}.py"): f"role_{role}.py",
        Path("tests", f"test_{module}.py"): "test_reader.py"
        if role == "reader"
        else "test.py",
    }
    if role == "reader":
        contents[Path("tests", "map.xyz")] = "map.xyz"
    target = folder / f"chemage-{name}"
    try:
        target.mkdir()
        for path, template in contents.items():
            (target / path).parent.mkdir(parents=True, exist_ok=True)
            create(target / path, _template(template).format(**words).encode())
    except FileExistsError:
        raise StoreError(
            f"{target} is already there; choose another name or folder"
        ) from None
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror}") from error
    return [target / path for path in contents]


def version_range() -> str:
    """The versions of chemage that a plugin written now works with: from this one to before the next major one."""
    major, minor, *_ = __version__.split(".")
    return f">={major}.{minor},<{int(major) + 1}"


def _warn_if_taken(name: str, role: str, package: str) -> None:
    plugins = registry.current()
    taken = [
        f"{role} {name!r} comes with {record.name!r} ({record.source}); choose another name, or write "
        f'"{package}:{name}" in scenes'
        for record in plugins.offers(role, name)
    ]
    taken += [
        f"a plugin {package!r} is there: {record.source}; the new one cannot be used beside it, so choose another name"
        for record in plugins.records
        if record.name == package
    ]
    if taken:
        warnings.warn("; ".join(taken), registry.PluginWarning, stacklevel=3)


def _template(name: str) -> str:
    return (
        resources.files("chemage.scaffold")
        .joinpath("templates", f"{name}.in")
        .read_text(encoding="utf-8")
    )


_MADE = "# Made by `chemage plugins stubs`; do not edit.\n"
_HEAD = f"""{_MADE}from collections.abc import Sequence
from typing import Any, Literal, overload

from chemage.foundation.units import QuantityLike
from chemage.foundation.names import __version__ as __version__
"""


def stubs() -> dict[str, str]:
    """File -> text of the stubs of ``chemage``: every public name, and of the factories an overload for each kind.

    A kind that the stub does not know is an error to a type checker; use its class, or make a stub of your own.
    """
    authors = {*HOME, *MODULES} - USERS
    return {
        "__init__.pyi": _users_stub(),
        "plugin.pyi": "".join([_MADE, *_imports(authors)]),
    }


def _imports(names: Iterable[str]) -> Iterable[str]:
    brought = registry.current().offered("names")
    for name in sorted(names):
        own = f"chemage.{MODULES.get(name) or f'{HOME.get(name)}.{name}'}"
        module, _, last = brought.get(name, own).replace(":", ".").rpartition(".")
        yield f"from {module} import {last} as {name}\n"


def _users_stub() -> str:
    plugins = registry.current()
    factories = {
        role: name
        for role in plugins.roles
        if (name := FACTORIES.get(role, role)) in HOME
    }
    returned = {plugins.role(role).__name__ for role in factories}
    lines = [
        _HEAD,
        *_imports({*USERS, *plugins.offered("names")} - set(factories.values())),
    ]
    lines += [
        f"from chemage.{HOME[name]} import {name}\n" for name in sorted(returned)
    ]
    for role, factory in factories.items():
        base = plugins.role(role).__name__
        kinds = plugins.kinds(role)
        for kind in kinds:
            try:
                options = list(_options(plugins.component(role, kind)))
            except PluginError as error:
                warnings.warn(
                    f"not in the stubs: {error}",
                    registry.PluginWarning,
                    stacklevel=2,
                )
                continue
            arguments = f", *, {', '.join(options)}" if options else ""
            lines.append(
                f'\n@overload\ndef {factory}(kind: Literal["{kind}"]{arguments}) -> {base}: ...'
            )
        if len(kinds) == 1:  # one overload is none
            lines[-1] = lines[-1].replace("@overload\n", "")
        lines.append("\n")
    return "".join(lines)


def _options(cls: Any) -> Iterable[str]:
    """``name: type`` or ``name: type = ...`` of each option."""
    properties = cls.model_json_schema(mode="validation").get("properties", {})
    for name, info in cls.model_fields.items():
        yield f"{name}: {_type(properties.get(name, {}))}" + (
            "" if info.is_required() else " = ..."
        )


def _type(schema: Mapping[str, Any]) -> str:
    """A JSON Schema as a Python type; what is not plain is Any."""
    if "unit" in schema:
        further = [
            _type(part)
            for part in schema.get("anyOf", ())
            if part.get("type") not in ("number", "string")
        ]
        return " | ".join(dict.fromkeys(["QuantityLike", *further]))
    if "enum" in schema or "const" in schema:
        return f"Literal[{', '.join(repr(value) for value in schema.get('enum', [schema.get('const')]))}]"
    if "anyOf" in schema:
        parts = list(dict.fromkeys(_type(part) for part in schema["anyOf"]))
        return (
            "Any"
            if "Any" in parts
            else " | ".join(
                part for part in parts if part != "int" or "float" not in parts
            )
        )
    if schema.get("type") == "array":
        return f"Sequence[{_type(schema.get('items', {})) if isinstance(schema.get('items'), dict) else 'Any'}]"
    names = {
        "number": "float",
        "integer": "int",
        "string": "str",
        "boolean": "bool",
        "null": "None",
    }
    names["object"] = "dict[str, Any]"
    return names.get(schema.get("type", ""), "Any")
