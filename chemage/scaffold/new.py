"""``chemage plugins new``: creates a working plugin with tests of the requirements of its role."""

from __future__ import annotations

import keyword
import re
import warnings
from importlib import resources
from pathlib import Path

from chemage.foundation.errors import InputError, StoreError
from chemage.foundation.messages import nearest
from chemage.foundation.version import __version__
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
    roles = list(registry.current().roles)
    if role not in roles:
        raise InputError(f"no role {role!r}{nearest(role, roles)}; the roles are {', '.join(roles)}")
    module = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) or keyword.iskeyword(module):
        raise InputError.of(
            "name", name, "is not a valid kind", "use lower-case words joined by -, such as my-barriers"
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
        Path("tests", f"test_{module}.py"): "test_reader.py" if role == "reader" else "test.py",
    }
    if role == "reader":
        contents[Path("tests", "map.xyz")] = "map.xyz"
    target = folder / f"chemage-{name}"
    try:
        target.mkdir()
        for path, template in contents.items():
            (target / path).parent.mkdir(parents=True, exist_ok=True)
            (target / path).write_text(_template(template).format(**words), encoding="utf-8")
    except FileExistsError:
        raise StoreError(f"{target} is already there; choose another name or folder") from None
    except OSError as error:
        raise StoreError(f"cannot write {target}: {error.strerror}") from error
    return [target / path for path in contents]


def version_range() -> str:
    """The versions of chemage that a plugin written now works with: from this one to before the next major one."""
    major, minor, *_ = __version__.split(".")
    return f">={major}.{minor},<{int(major) + 1}"


def _warn_if_taken(name: str, role: str, package: str) -> None:
    plugins = registry.current()
    taken = [f"{role} {name!r} comes with {record.name!r} ({record.source})" for record in plugins.offers(role, name)]
    taken += [f"a plugin {package!r} is there: {record.source}" for record in plugins.records if record.name == package]
    if taken:
        warnings.warn(
            f"{'; '.join(taken)}; the new plugin cannot be used beside it, so choose another name",
            registry.PluginWarning,
            stacklevel=3,
        )


def _template(name: str) -> str:
    return resources.files("chemage.scaffold").joinpath("templates", f"{name}.in").read_text(encoding="utf-8")
