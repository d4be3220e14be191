"""The interface for plugins, as ``tests/plugins/api.json`` records it; ``python tests/stubs/plugin_api.py`` records it
anew."""

from __future__ import annotations

import importlib
import inspect
import json
from pathlib import Path
from typing import Any

from chemage.foundation import names
from chemage.plugin import API_VERSION, registry

FILE = Path(__file__).parents[1] / "plugins" / "api.json"


def arguments(function: Any) -> list[str]:
    """The arguments of a function in order; ``name=`` has a default, ``*, `` comes before those by name only."""
    found = []
    for one in inspect.signature(function).parameters.values():
        if one.kind is one.KEYWORD_ONLY and "*" not in found and not any(name.startswith("*") for name in found):
            found.append("*")
        mark = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        found.append(f"{mark}{one.name}{'' if one.default is one.empty else '='}")
    return found


def present() -> dict[str, Any]:
    """The interface of this chemage."""
    plugins = registry.current()
    hooks = {
        name: arguments(function)
        for room in registry.ROOMS
        for name, function in vars(importlib.import_module(room)).items()
        if name.startswith("chemage_")
    }
    roles = {}
    for role in plugins.roles:
        cls = plugins.role(role)
        methods = {
            name: arguments(function)
            for name, function in vars(cls).items()
            if inspect.isfunction(function) and not name.startswith("__")
        }
        annotated = {name for base in cls.__mro__ for name in vars(base).get("__annotations__", {})}
        attributes = [name for name in annotated if hasattr(cls, name) and not name.startswith(("_", "model_"))]
        abstract = sorted(getattr(cls, "__abstractmethods__", ()))
        roles[role] = {
            "class": cls.__name__,
            "abstract": abstract,
            "methods": dict(sorted(methods.items())),
            "attributes": sorted(attributes),
        }
    return {
        "api": API_VERSION,
        "names": sorted({*names.HOME, *names.MODULES, *plugins.offered("names"), "__version__"}),
        "modules": {name: f"chemage.{module}" for name, module in sorted(names.MODULES.items())},
        "hooks": dict(sorted(hooks.items())),
        "roles": roles,
    }


def recorded() -> dict[str, Any]:
    """The interface that ``api.json`` records."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def broken(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What a plugin written for the interface ``before`` does not find in ``now``, a sentence each."""
    said = [f"the public name {name} is gone" for name in before["names"] if name not in now["names"]]
    for name, module in before["modules"].items():
        if now["modules"].get(name) != module:
            said.append(f"the public module {module} is gone")
    for hook, given in before["hooks"].items():
        gone = set(given) - set(now["hooks"].get(hook, ()))
        said += [f"{hook} is gone"] if hook not in now["hooks"] else [f"{hook}: {one} is gone" for one in sorted(gone)]
    for role, old in before["roles"].items():
        new = now["roles"].get(role)
        if new is None or new["class"] != old["class"]:
            said.append(f"role {role}: {old['class']} is gone")
            continue
        said += [f"{role}: plugins must now define {one}" for one in new["abstract"] if one not in old["abstract"]]
        said += [f"{role}: the attribute {one} is gone" for one in old["attributes"] if one not in new["attributes"]]
        for name, given in old["methods"].items():
            found = new["methods"].get(name, [])
            added = found[len(given) :]
            # what is added is passed by name, and only to plugins that name it
            by_name = "*" in given or added[:1] == ["*"]
            optional = by_name and all(one.endswith("=") or one.startswith("*") for one in added)
            if found[: len(given)] != given or (added and not optional):
                said.append(f"{role}: {name}({', '.join(given)}) is now {name}({', '.join(found)})")
    return said


if __name__ == "__main__":
    FILE.write_text(json.dumps(present(), indent=1) + "\n", encoding="utf-8")
