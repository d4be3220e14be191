"""Who may import whom: the framework no plugin, a plugin only what is public, a kernel only kernels, a room only rooms
above it; and nothing in the framework names a kind, an output or a figure of a plugin.
"""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import chemage as ca
from chemage.foundation import names
from chemage.plugin import figures, registry, statistics

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(path.name for path in (ROOT / "plugins").iterdir() if (path / "__init__.py").exists())

#: the rooms, in the order in which data flow; each may use those before it
ROOMS = (
    "foundation",
    "plugins",
    "surfaces",
    "contacts",
    "lattices",
    "kinetics",
    "friction",
    "ageing",
    "scene",
    "studies",
    "results",
    "scaffold",
    "testing",
    "cli",
)
#: modules in no room: those through which users and plugins reach the rooms
FRONT = {"chemage", "chemage.plugin", "chemage.__main__"}
#: what a kernel may use of the framework
FOR_KERNELS = {"chemage.foundation.random", "chemage.foundation.algebra", "chemage.foundation.kernels"}
#: modules that import numba and compile nothing -> what they want of it
NO_KERNELS = {
    "chemage.testing.engines": "the number of threads, which an engine must not depend on",
    "chemage.foundation.compiling": "when something is compiled",
    "chemage.foundation.kernels": "the decorator of kernels, and where they are kept",
}


def sources(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def module_of(path: Path) -> str:
    """The dotted name by which a file is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts[path.is_relative_to(ROOT / "plugins") :]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for folder in ("chemage", "plugins") for path in sources(folder)}
FRAMEWORK_MODULES = {name: path for name, path in MODULES.items() if name.partition(".")[0] == "chemage"}
PLUGIN_MODULES = {name: path for name, path in MODULES.items() if name not in FRAMEWORK_MODULES}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree(path)))


@cache
def imports(module: str) -> tuple[tuple[int, str, str], ...]:
    """(line, module, name) of every import, also inside functions and under TYPE_CHECKING; the name is "" for
    ``import x``."""
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[tuple[int, str, str]]:
    package = module.split(".") if MODULES[module].name == "__init__.py" else module.split(".")[:-1]
    for node in nodes(MODULES[module]):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            yield from ((node.lineno, source, alias.name) for alias in node.names)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) == "import_module":
            yield from ((node.lineno, str(name.value), "") for name in node.args[:1] if isinstance(name, ast.Constant))


def imported_modules(module: str) -> Iterator[tuple[int, str]]:
    """(line, module) of every import of one of our own modules; a public name counts as the module it is in."""
    for line, source, name in imports(module):
        full = f"{source}.{name}"
        if full in MODULES:
            yield line, full
        elif source in ("chemage", "chemage.plugin") and name in (homes := {**names.HOME, **names.MODULES}):
            yield line, f"chemage.{homes[name]}"
        elif source in MODULES:
            yield line, source


def where(module: str, line: int) -> str:
    return f"{MODULES[module].relative_to(ROOT)}:{line}"


# -- the framework and its plugins ------------------------------------------------------------------------------------


@pytest.mark.long
def test_users_need_no_pytest():
    """pytest is not installed with chemage: only the checks of plugins use it, and `chemage selftest` runs without."""
    code = "import sys; sys.modules['pytest'] = None; import chemage.testing.selftest"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    bad = [
        where(module, line)
        for module in MODULES
        for line, source, _ in imports(module)
        if source.partition(".")[0] == "pytest" and module != "chemage.testing.checks"
    ]
    assert not bad, f"imports pytest: {bad}"


def test_the_framework_imports_no_plugin():
    for module in FRAMEWORK_MODULES:
        for line, source, _ in imports(module):
            assert source.partition(".")[0] not in {*PLUGINS, "plugins"}, f"{where(module, line)} imports {source}"


def private_uses(module: str) -> Iterator[str]:
    """Where a module of a plugin reaches for what is not public, a sentence each."""
    package = module.partition(".")[0]
    public = {"chemage": ca, "chemage.plugin": ca.plugin}
    for line, source, name in imports(module):
        top, at = source.partition(".")[0], where(module, line)
        if top == "chemage":
            offered = name in public[source].__all__ if name and source in public else source in public
            if not offered and (source, name) != ("chemage", "testing"):
                yield f"{at} imports {name or source} of {source}, which is not public"
        elif top in PLUGINS and top != package and (source != top or name.startswith("_")):
            yield f"{at}: another plugin is used by what its package offers"
    for node in nodes(MODULES[module]):
        used = ast.unparse(node.value) if isinstance(node, ast.Attribute) else ""
        if used in public and node.attr not in public[used].__all__:
            yield f"{where(module, node.lineno)}: {node.attr} is no public name of {used}"


def test_a_plugin_uses_only_what_is_public():
    assert [problem for module in PLUGIN_MODULES for problem in private_uses(module)] == []


def defined(paths: list[Path]) -> set[str]:
    """Every name that these files define: functions, classes, attributes, fields, variables, modules."""
    names = {path.stem for path in paths}
    for path in paths:
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                names.add(node.id if isinstance(node, ast.Name) else node.attr)
    return names


@cache
def framework() -> set[str]:
    return defined(sources("chemage"))


def test_no_private_name_is_reached_through_a_public_one():
    """``surface._digest`` and ``registry._current`` are not an interface either."""
    for name in PLUGINS:
        own = defined(sources(f"plugins/{name}"))
        for path in sources(f"plugins/{name}"):
            for node in nodes(path):
                if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
                    assert node.attr in own or node.attr not in framework(), f"{path}:{node.lineno} reaches {node.attr}"


def test_private_names_of_the_framework_were_found():
    assert {"_digest", "_current", "_parse", "_classes"} <= framework()


def test_every_plugin_package_is_an_entry_point():
    with open(ROOT / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)
    assert sorted(project["project"]["entry-points"]["chemage"].values()) == PLUGINS


def test_every_package_is_installed_and_found_by_editors():
    with open(ROOT / "pyproject.toml", "rb") as file:
        build = tomllib.load(file)["tool"]["hatch"]["build"]
    assert build["targets"]["wheel"] == {
        "only-include": ["chemage", "plugins"],
        "exclude": ["plugins/*/docs", "ruff.toml"],
        "sources": ["plugins"],
    }
    # an editable install adds them in a .pth file, which type checkers read
    assert build["dev-mode-dirs"] == [".", "plugins"]
    for name, path in MODULES.items():
        folder = path.parents[name.count(".") + (path.name == "__init__.py")]
        assert folder in (ROOT, ROOT / "plugins")
        assert path.name == "__init__.py" or (path.parent / "__init__.py").exists(), f"{path.parent} is no package"


def test_ci_tests_every_library_at_its_floor():
    """All but ContactMechanics, which needs a newer numpy, and the tools of the documentation and of developers."""
    with open(ROOT / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)["project"]
    script = (ROOT / ".ci" / "run").read_text()
    extras = re.search(r'^ *prepare oldest python3 "==" (.*)', script, re.MULTILINE)[1]
    functions = re.search(r"^libraries\(\) \{.*?^\}", script, re.MULTILINE | re.DOTALL)[0]
    command = ["bash", "-c", f"{functions}\nlibraries {extras}"]
    installed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    needed = {*project["dependencies"]}
    for name, libraries in project["optional-dependencies"].items():
        needed |= {*libraries} if name not in ("docs", "dev", "contactmechanics") else set()
    assert {*installed} == {one for one in needed if not one.startswith("chemage")}
    assert [one for one in installed if not re.fullmatch(r"[\w-]+>=[\d.]+", one)] == []


# -- the one door to files --------------------------------------------------------------------------------------------

#: modules that open files by their names: the door, and the memory of this machine, which the door rests on
DOOR = ("chemage.foundation.files", "chemage.foundation.container", "chemage.foundation.memory")
#: methods of paths, and functions of libraries, that do so as well
_METHODS = {"open", "read_bytes", "read_text", "write_bytes", "write_text", "touch"}
_FUNCTIONS = re.compile(
    r"open|(io|os|gzip|codecs)\.open|os\.fdopen|logging\.FileHandler|tomllib\.load|zipfile\.ZipFile|ZipFile|shutil\.(copy\w*|move)|"
    r"(np|numpy)\.(load|loadtxt|genfromtxt|fromfile|memmap|save\w*)|(h5py|h5netcdf)\.File|(xr|xarray)\.\w*open\w*"
)
#: what looks like one of these, and is none: the door itself, files of packages, what has no name
_OTHERS = re.compile(r"(tables|files)\.read_text|(importlib\.)?resources\.files\(.*|(self|study|library)\.open")
#: (module, call) -> why
OPENS = {
    ("chemage.cli.app", "open"): "no file: what a closed output becomes",
    ("chemage.cli.app", "os.open"): "what is printed after the reader of a pipe has gone",
    ("chemage.foundation.kernels", "open"): "sources that were imported; the door takes ten times as long",
    ("chemage.foundation.tables", "ZipFile"): "a stream that the door opened",
    ("chemage.foundation.tables", "np.loadtxt"): "lines in memory",
    ("chemage.studies.sweeps.table", "h5netcdf.File"): "an image in memory",
    ("chemage.testing.selftest", "np.save"): "in a folder of its own",
    ("chemage.testing.selftest", "np.savetxt"): "in a folder of its own",
    ("chemage.testing.selftest", "h5py.File"): "in a folder of its own",
    ("chemage_surfaces.instruments", "zipfile.ZipFile"): "an archive in memory",
    ("chemage_li2018.sweeps", "np.savez_compressed"): "an image in memory",
    ("chemage_li2018.sweeps", "np.load"): "a file that the door opened",
}


def opened(module: ast.Module) -> Iterator[tuple[int, str]]:
    """(line, call) of each call that opens a file by its name."""
    for node in ast.walk(module):
        if isinstance(node, ast.Call) and not _OTHERS.fullmatch(call := ast.unparse(node.func)):
            method = isinstance(node.func, ast.Attribute) and node.func.attr in _METHODS
            if method or _FUNCTIONS.fullmatch(call):
                yield node.lineno, call


def test_every_way_to_open_a_file_is_known():
    ways = [
        "open(p)",
        "Path(p).read_bytes()",
        "p.open('a')",
        "(a / b).write_text('')",
        "np.load(p)",
        "np.savez(p)",
    ]
    ways += ["h5py.File(p)", "tomllib.load(p)", "os.open(p, 0)", "p.read_text()", "np.loadtxt(p)", "shutil.copy(p, q)"]
    assert len(list(opened(ast.parse("\n".join(ways))))) == len(ways)
    others = ["tables.read_text(p)", "resources.files('x').joinpath('y').read_text()", "study.open()", "open_file(p)"]
    assert list(opened(ast.parse("\n".join(others)))) == []


def test_files_are_opened_by_one_door():
    """What opens files checks that they are ordinary ones, their size, and where links lead."""
    found = {
        (module, call): where(module, line)
        for module in MODULES
        if module not in DOOR
        for line, call in opened(tree(MODULES[module]))
    }
    assert {key: at for key, at in found.items() if key not in OPENS} == {}
    assert found.keys() == OPENS.keys(), "what is no longer there needs no exception"


# -- kernels ----------------------------------------------------------------------------------------------------------


def imports_numba(module: str) -> bool:
    return any(source.partition(".")[0] == "numba" for _, source, _ in imports(module))


def imports_decorator(module: str) -> bool:
    return any(target == "chemage.foundation.kernels" for _, target in imported_modules(module))


def compiled_with(module: str) -> set[str]:
    """Names of the decorators in a module, as far as they are plain names: ``jit`` of ``@jit``."""
    found = set()
    for node in nodes(MODULES[module]):
        if isinstance(node, ast.FunctionDef):
            for decorator in node.decorator_list:
                target = decorator.func if isinstance(decorator, ast.Call) else decorator
                found |= {target.id} if isinstance(target, ast.Name) else set()
    return found


@cache
def kernels() -> frozenset[str]:
    """Modules that compile functions: they import numba, at any level, or a decorator from a module that does."""
    found = {module for module in MODULES if imports_numba(module) or imports_decorator(module)} - NO_KERNELS.keys()
    while True:
        more = {
            module
            for module in MODULES
            for _, source, name in imports(module)
            if source in found and name in compiled_with(module)
        }
        if more <= found:
            return frozenset(found)
        found |= more


def test_the_kernels_were_found():
    assert kernels() >= {
        "chemage.foundation.random",
        "chemage.lattices.kernels",
        "chemage_contact._kernels",
        "chemage_bonds._kernels",
        "chemage_kinetics._common",
        "chemage_kinetics._bkl",
        "chemage_kinetics._independent",
        "chemage_kinetics._next_reaction",
        "chemage_kinetics._rejection_free",
    }


def test_a_kernel_knows_nothing_of_the_framework():
    for module in kernels():
        for line, target in imported_modules(module):
            allowed = target in FOR_KERNELS or target in kernels()
            assert allowed, f"{where(module, line)}: a kernel imports {target}"
            # of others an update would not be noticed
            alike = target in FOR_KERNELS or target.rpartition(".")[0] == module.rpartition(".")[0]
            assert alike, f"{where(module, line)}: a kernel imports {target} of another package"


def test_what_imports_numba_without_a_kernel_compiles_nothing():
    for module in NO_KERNELS:
        assert imports_numba(module)
        text = MODULES[module].read_text(encoding="utf-8")
        assert not re.search(r"@(\w+\.)?(n?jit|vectorize|guvectorize|intrinsic|prange)\b", text)


# -- rooms ------------------------------------------------------------------------------------------------------------


def room(module: str) -> str:
    return module.split(".")[1]


def test_every_module_is_in_a_room():
    assert {room(module) for module in FRAMEWORK_MODULES if module not in FRONT} == set(ROOMS)


def test_a_room_imports_only_rooms_above_it():
    for module in set(FRAMEWORK_MODULES) - FRONT:
        for line, target in imported_modules(module):
            if target in FRAMEWORK_MODULES:
                at = where(module, line)
                assert target not in FRONT, f"{at} imports through the package; name the module"
                assert ROOMS.index(room(target)) <= ROOMS.index(room(module)), f"{at} imports {target}"


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The strongly connected components with more than one member (Tarjan, SIAM J. Comput. 1, 146 (1972))."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in graph[node]:
            if other not in order:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == order[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in graph:
        if node not in order:
            visit(node)
    return found


def test_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [["a", "b", "c"]]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_no_module_imports_itself_by_a_detour():
    """Imports inside functions and for type checkers count: a circle that is put off is still a circle."""
    for modules in (FRAMEWORK_MODULES, PLUGIN_MODULES):
        graph = {
            module: {target for _, target in imported_modules(module) if target in modules and target != module}
            for module in modules
            if module not in FRONT
        }
        assert circles(graph) == []


# -- words of plugins -------------------------------------------------------------------------------------------------

#: (file, word) -> why the framework may say it; examples in docstrings and in help
SAYS = {
    ("chemage/ageing/age.py", "bkl"): "example in a message",
    ("chemage/ageing/age.py", "barrier-spectrum"): "example in a message",
    ("chemage/cli/plugins.py", "fft-bem"): "example in help",
    ("chemage/contacts/role.py", "fft-bem"): "example in a docstring",
    ("chemage/scaffold/__init__.py", "fft-bem"): "example in a docstring",
    ("chemage/contacts/role.py", "hertz"): "example in a message",
    ("chemage/kinetics/role.py", "rejection-free"): "example in a message",
    ("chemage/kinetics/role.py", "bkl"): "example in a docstring and a message",
    ("chemage/lattices/chemistry.py", "md-silica"): "example in a docstring",
    ("chemage/surfaces/role.py", "self-affine"): "example in a docstring",
    ("chemage/surfaces/role.py", "sphere"): "example in a message",
    # words that mean something else as well
    ("chemage/cli/results.py", "text"): "a format of citations",
    ("chemage/cli/studies.py", "hdf5"): "the format of a sweep's table",
    ("chemage/lattices/lattice.py", "independent"): "of sites without neighbours",
    ("chemage/foundation/names.py", "text"): "the name of a module",
    ("chemage/scene/materials.py", "measured"): "how a value is known",
    ("chemage/lattices/role.py", "uniform"): "an argument",
    ("chemage/contacts/display.py", "pressures"): "the figure of the pressures in several contacts",
    ("chemage/foundation/figures.py", "auto"): "matplotlib's aspect",
    ("chemage/foundation/figures.py", "text"): "an argument",
    ("chemage/foundation/figures.py", "pressures"): "the name of that figure",
    ("chemage/studies/study.py", "auto"): "the share that a job array names, and no engine",
    ("chemage/studies/sweeps/running.py", "auto"): "the same",
    ("chemage/studies/ensembles/running.py", "auto"): "the same",
    ("chemage/ageing/methods.py", "steps"): "what progress counts",
    ("chemage/studies/ensembles/stages.py", "steps"): "the same",
    ("chemage/foundation/limits.py", "heating"): "what may be wrong on a machine",
}


def own_records() -> list[registry.PluginRecord]:
    return [record for record in registry.current().records if record.distribution == "chemage"]


def outputs_and_figures(examples) -> set[str]:
    """The names that the built-in observables give to what they measure, and those of all figures of plugins."""
    contact = examples.contact()
    silica = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.4))
    lattice = ca.plugin.build_lattice(silica, contact, 1)
    history = examples.history(state=np.ones(lattice.sites.size, bool))
    found = set()
    for record in own_records():
        for role, kinds in record.kinds.items():
            for kind in kinds:
                found |= {*registry.current().component(role, kind).figures}
        for kind in record.kinds.get("observable", ()):
            found |= {*ca.observable(kind).measure(contact, lattice, history)}
    own = {record.name for record in own_records()}
    for record, function in registry.current().functions("chemage_figures"):
        found |= {*function()} if record.name in own else set()
    return found


def test_figures_of_chemage_itself_are_not_those_of_plugins(examples):

    assert "barriers" in outputs_and_figures(examples)
    # "pressures" is also an output of an observable, which is no figure
    assert outputs_and_figures(examples) & {*figures.CORE} <= {"pressures"}


def test_the_framework_names_no_kind_output_or_figure_of_a_plugin(examples):
    kinds = {kind for record in own_records() for offered in record.kinds.values() for kind in offered}
    assert kinds >= {"hertz", "self-affine", "rejection-free"}
    names = outputs_and_figures(examples)
    assert names
    # the role of barriers has the name of a figure of barriers
    words = kinds | (names - set(registry.current().roles))
    any_word = re.compile("|".join(map(re.escape, words)))
    said = {}
    for path in sources("chemage"):
        file = path.relative_to(ROOT).as_posix()
        for node in nodes(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and any_word.search(node.value):
                for word in words:
                    quoted = rf"""["'`]{re.escape(word)}["'`]"""
                    hyphened = rf"(?<![\w-]){re.escape(word)}(?![\w-])" if "-" in word else quoted
                    if node.value == word or re.search(quoted, node.value) or re.search(hyphened, node.value):
                        said.setdefault((file, word), node.lineno)
    unexpected = {f"{file}:{line} says {word!r}" for (file, word), line in said.items() if (file, word) not in SAYS}
    assert unexpected == set()
    assert set(SAYS) <= set(said), "no longer said; take it off the list"


# -- one of each ------------------------------------------------------------------------------------------------------


def files_that(has: Callable[[ast.AST], bool], folders: Iterable[str] = ("chemage",)) -> set[str]:
    return {
        path.relative_to(ROOT).as_posix()
        for folder in folders
        for path in sources(folder)
        if any(map(has, nodes(path)))
    }


#: file -> why it has a line of its own through values against log10 of hold times
OTHER_LINES = {
    "plugins/chemage_inference/curves.py": "whether values measured with different errors fall; no β",
    "plugins/chemage_li2018/sweeps.py": "β of a mean over surfaces, as the paper has it",
}
#: what fits a line
FITS = {"polyfit", "lstsq", "linregress", "curve_fit"}


def fits_a_line_in_log_time(node: ast.AST) -> bool:
    called = node.func if isinstance(node, ast.Call) else None
    return getattr(called, "attr", getattr(called, "id", "")) in FITS and "log10" in ast.unparse(node)


def test_one_function_fits_beta():
    """The slope against log10 of the hold time is :func:`chemage.ageing.fitting.line_slopes`, for every result."""
    assert files_that(fits_a_line_in_log_time, ("chemage", "plugins")) == set(OTHER_LINES)
    assert "line_slopes" in defined([ROOT / "chemage/ageing/fitting.py"])


#: file -> why it hashes
HASHES = {
    "chemage/foundation/container.py": "the seal of files",
    "chemage/foundation/records.py": "content_hash, text_hash, the digest of arrays, checksums by which changes are seen",
    "chemage/foundation/random.py": "the number of a named stream; a module of kernels, which imports no other",
}


def test_one_seal_and_one_hash():
    libraries = {"hashlib", "zlib", "binascii"}
    hashing = {
        MODULES[module].relative_to(ROOT).as_posix()
        for module in FRAMEWORK_MODULES
        for _, source, _ in imports(module)
        if source in libraries
    }
    assert hashing == set(HASHES)


#: file -> why it has 1 - exp(-x): the bonds of a two-state site, or something else
EXPM1 = {
    "chemage/lattices/independent.py": "two-state sites, for arrays",
    "plugins/chemage_kinetics/_independent.py": "two-state sites, for kernels",
    "chemage/contacts/theory.py": "a difference of two Gaussians",
    "chemage/results/arrhenius.py": "an interval of a logarithm",
    "plugins/chemage_inference/kernels.py": "the other tail of a normal distribution",
    "plugins/chemage_bonds/distributions.py": "a difference of two probabilities",
    "plugins/chemage_bonds/rupture.py": "a hazard that grows exponentially from zero",
}


def is_expm1(node: ast.AST) -> bool:
    """``expm1(x)``, or ``1 - exp(-x)``."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
        return bool(re.fullmatch(r"1(\.0)? - (np|math)\.exp\(-.*\)", ast.unparse(node), re.DOTALL))
    return isinstance(node, ast.Attribute) and node.attr == "expm1"


def test_one_closed_form_of_two_states_for_arrays_and_one_for_kernels():
    """Checks of engines have their own, on purpose: they are the independent truth."""
    found = {file for file in files_that(is_expm1, ("chemage", "plugins")) if "/testing/" not in file}
    assert found == set(EXPM1)


def test_one_limit_of_a_95_percent_interval():
    def is_limit(node: ast.AST) -> bool:
        value = node.value if isinstance(node, ast.Constant) else None
        return isinstance(value, float) and abs(value - statistics.NORMAL_LIMIT) < 1e-4

    assert files_that(is_limit, ("chemage", "plugins")) == {"chemage/foundation/statistics.py"}


# -- words of stages --------------------------------------------------------------------------------------------------

#: a section -> how many files say its word, and what else it means; never more
SPOKEN = {
    "surface": (20, "a part of results, a phase of progress, an argument"),
    "contact": (28, "a part of results, a phase of progress, an argument, the group of files"),
    "chemistry": (19, "an entry of the provenance that every file since 0.1 has, an argument"),
    "engine": (13, "an entry of that provenance and a row of summaries, an argument"),
    "ageing": (26, "a phase of progress and of costs, a part of results, the group of files, an argument"),
    "hold": (10, "a table of options without a component: its values are changed by name"),
    "observe": (5, "an argument of age()"),
    "ensemble": (13, "a kind of result and its files"),
    "accuracy": (7, "an option of commands and the goals of means"),
}
#: files that may say the word of any other section: its hooks, its role, and one more
MOST_SPOKEN = 3


def test_few_files_say_the_word_of_a_stage():
    """A stage declares itself; elsewhere ``Rupture.role``, or a loop over what is declared."""
    for stage in registry.current().stages():
        if room(type(stage).__module__) not in ROOMS:
            continue
        word = stage.section
        files = files_that(lambda node, word=word: isinstance(node, ast.Constant) and node.value == word)
        most, _ = SPOKEN.get(word, (MOST_SPOKEN, ""))
        assert 0 < len(files) <= most, f"{len(files)} files say {word!r}, {most} may: {sorted(files)}"
    assert {*SPOKEN} <= {stage.section for stage in registry.current().stages()}


# -- sizes ------------------------------------------------------------------------------------------------------------

#: nodes of the syntax tree, whose number does not depend on how the code is laid out
MOST_OF_A_FILE, MOST_OF_A_FUNCTION = 6200, 840


def test_no_file_and_no_function_is_too_long():
    def size(node: ast.AST) -> int:
        return sum(1 for _ in ast.walk(node))

    long = []
    for module, path in MODULES.items():
        if module in kernels():
            continue
        functions = [node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef)]
        long += [(module, node.name, size(node)) for node in functions if size(node) > MOST_OF_A_FUNCTION]
        if size(tree(path)) > MOST_OF_A_FILE:
            long.append((module, "", size(tree(path))))
    assert long == []


# -- tests ------------------------------------------------------------------------------------------------------------

#: test files that use modules of chemage that are no interface: as few as have been reached
MOST_INTERNAL = 18


def reaches_inside(path: Path) -> set[str]:
    """The modules of chemage besides the public ones that a file imports, or names in a call such as ``setattr``."""
    reached: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            reached |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            reached |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call):
            words = [word.value for word in node.args[:1] if isinstance(word, ast.Constant)]
            reached |= {word for word in words if isinstance(word, str) and re.fullmatch(r"chemage(\.\w+){2,}", word)}
    public = "|".join([*ca.__all__, "plugin", "testing"])
    return {name for name in reached if re.match(rf"chemage\.(?!({public})(\.|$))", name)}


def test_tests_use_public_names_except_a_few():
    """So that they survive a redesign, and say what it must keep."""
    files = [path for path in sources("tests") if path.name.startswith(("test_", "conftest"))]
    inside = {path.relative_to(ROOT).as_posix(): sorted(names) for path in files if (names := reaches_inside(path))}
    listed = "\n".join(f"{file}: {', '.join(names)}" for file, names in inside.items())
    assert len(inside) <= MOST_INTERNAL, f"{len(inside)} files use what is private:\n{listed}"


def test_what_benchmarks_import_exists():
    """They are run by hand, so that nobody else would see a name that has moved."""
    for path in sources("tests/benchmarks"):
        for node in nodes(path):
            if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ("chemage", *PLUGINS):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    known = hasattr(module, alias.name) or f"{node.module}.{alias.name}" in MODULES
                    assert known, f"{path.name}:{node.lineno}: {node.module} has no {alias.name}"


def test_a_module_of_the_tests_is_the_same_for_every_test():
    """No file changes the path of imports when it is collected, and no two modules on it have one name."""
    on_the_path = [path.stem for folder in ("tests/stubs", "tests/benchmarks") for path in (ROOT / folder).glob("*.py")]
    assert len(on_the_path) == len(set(on_the_path))
    for path in sources("tests"):
        changes = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("sys.path")]
        assert not (changes and path.name.startswith("test_")), f"{path.name}: {changes}"
