"""Who may import whom: the framework no plugin, a plugin only what is public, a kernel nothing but random numbers."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(path.name for path in (ROOT / "plugins").iterdir() if (path / "__init__.py").exists())

#: the modules of chemage that a plugin may use; their public names stay what they are within an API version
PUBLIC = {
    "chemage",
    "chemage.errors",
    "chemage.hookspecs",
    "chemage.measures",
    "chemage.objects",
    "chemage.plots",
    "chemage.random",
    "chemage.registry",
    "chemage.runs",
    "chemage.scene",
    "chemage.spec",
    "chemage.store",
    "chemage.sweeps",
    "chemage.testing",
    "chemage.threads",
    "chemage.units",
}


def sources(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def imports(path: Path) -> Iterator[tuple[int, str, str]]:
    """(line, module, name) of every import in a file, also of those inside functions; name is "" for ``import x``."""
    parts = path.relative_to(ROOT).with_suffix("").parts[path.is_relative_to(ROOT / "plugins") :]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = ".".join([*parts[: -node.level], *([node.module] if node.module else [])])
            module = module if node.level else node.module or ""
            yield from ((node.lineno, module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "import_module":
            yield from ((node.lineno, str(name.value), "") for name in node.args[:1] if isinstance(name, ast.Constant))


def is_module(module: str) -> bool:
    """Whether this dotted name is a file of the framework."""
    stem = ROOT.joinpath(*module.split("."))
    return stem.with_suffix(".py").exists() or (stem / "__init__.py").exists()


def package(path: Path) -> str:
    return path.relative_to(ROOT / "plugins").parts[0]


def is_kernel(path: Path) -> bool:
    """A module whose top level imports numba; its functions are compiled."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return any(
        (isinstance(node, ast.Import) and any(alias.name == "numba" for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and node.module == "numba")
        for node in tree.body
    )


@pytest.mark.parametrize("path", sources("chemage"), ids=lambda path: path.name)
def test_the_framework_imports_no_plugin(path):
    for line, module, _ in imports(path):
        assert module.partition(".")[0] not in {*PLUGINS, "plugins"}, f"{path}:{line} imports {module}"


def in_plugins() -> list[Path]:
    return sources("plugins")


@pytest.mark.parametrize("path", in_plugins(), ids=lambda path: str(path.relative_to(ROOT / "plugins")))
def test_a_plugin_uses_only_what_is_public(path):
    for line, module, name in imports(path):
        where = f"{path}:{line}"
        top = module.partition(".")[0]
        if top == "chemage":
            full = f"{module}.{name}" if name and is_module(f"{module}.{name}") else module
            assert full in PUBLIC, f"{where} imports {full}, which is not public"
            assert not name.startswith("_"), f"{where} imports the private name {name} of {module}"
        elif top in PLUGINS and top != package(path):
            parts = [*module.split("."), name]
            assert not any(part.startswith("_") for part in parts), f"{where} imports {module}.{name}, private to {top}"
            assert module == top, f"{where} imports {module}; another plugin is used by what its package offers"


def defined(paths: list[Path]) -> set[str]:
    """Every name that these files define: functions, classes, attributes, fields, variables, modules."""
    names = {path.stem for path in paths}
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                names.add(node.id if isinstance(node, ast.Name) else node.attr)
    return names


FRAMEWORK = defined(sources("chemage"))


@pytest.mark.parametrize("name", PLUGINS)
def test_no_private_name_is_reached_through_a_public_one(name):
    """``surface._digest`` and ``registry._current`` are not an interface either."""
    own = defined(sources(f"plugins/{name}"))
    for path in sources(f"plugins/{name}"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
                assert node.attr in own or node.attr not in FRAMEWORK, f"{path}:{node.lineno} reaches {node.attr}"


def test_private_names_of_the_framework_were_found():
    assert {"_digest", "_current", "_parse", "_classes"} <= FRAMEWORK


KERNELS = [path for path in [*sources("chemage"), *sources("plugins")] if is_kernel(path)]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_kernel_knows_nothing_of_the_framework(path):
    own = {package(path)} if (ROOT / "plugins") in path.parents else set()
    for line, module, name in imports(path):
        top = module.partition(".")[0]
        if top == "chemage":
            assert (module, name) == ("chemage", "random") or module == "chemage.random", f"{path}:{line}: {module}"
        elif top in own:
            file = ROOT.joinpath("plugins", *(f"{module}.{name}" if module == top else module).split("."))
            assert is_kernel(file.with_suffix(".py")), f"{path}:{line}: {module}.{name} is no kernel"


def test_the_kernels_were_found():
    names = {f"{path.parent.name}/{path.name}" for path in KERNELS}
    assert {"chemage/random.py", "chemage/graph.py", "chemage_interactions/_kernels.py"} <= names
    assert any(name.startswith("chemage_kinetics/") for name in names)
    assert any(name.startswith("chemage_contact/") for name in names)


def test_every_plugin_package_is_an_entry_point():
    import tomllib

    with open(ROOT / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)
    assert sorted(project["project"]["entry-points"]["chemage"].values()) == PLUGINS
    packages = {package for package in project["tool"]["setuptools"]["packages"] if package in PLUGINS}
    assert sorted(packages) == PLUGINS
