"""What docstrings, comments and pages refer to exists: modules, their names, files, and private names of a package."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from chemage.foundation import names
from chemage.plugin import registry

ROOT = Path(__file__).parents[2]
FOLDERS = ("chemage", "plugins", "tests", "docs")
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
TEXTS = [
    ROOT / "README.md",
    ROOT / "pyproject.toml",
    *ROOT.glob("docs/**/*.md"),
    *ROOT.glob("plugins/*/docs/*.md"),
    *(ROOT / "chemage").rglob("*.in"),
]
#: references that need not exist: file -> references
ABSENT = {
    "docs/plugins.md": {"tests/test_weibull.py", "tests/test_hardness.py"},  # of the reader's plugins
    "tests/foundation/test_random.py": {"tests/kat_vectors"},  # of Random123
}


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts[path.is_relative_to(ROOT / "plugins") :]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in SOURCES if path.relative_to(ROOT).parts[0] in FOLDERS[:2]}
#: public names -> where they are
PUBLIC = {name: f"chemage.{home}" for name, home in {**names.HOME, **names.MODULES}.items()}
PUBLIC |= {name: target.partition(":")[0] for name, target in registry.current().offered("names").items()}


@cache
def defined(path: Path) -> frozenset[str]:
    """Every name that a file defines, imports or uses as an attribute."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        found |= {getattr(node, key) for key in ("id", "name", "arg", "attr") if isinstance(getattr(node, key, 0), str)}
        if isinstance(node, ast.alias):
            found.add(node.asname or node.name)
    return frozenset(found)


@cache
def everywhere() -> frozenset[str]:
    return frozenset().union(*map(defined, MODULES.values()))


def passages(path: Path) -> Iterator[tuple[int, str]]:
    """(line, text) of every comment and docstring of a Python file, and of every line of another one."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from enumerate(text.splitlines(), 1)
        return
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    yield from ((token.start[0], token.string) for token in tokens if token.type == tokenize.COMMENT)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield from enumerate(node.value.value.splitlines(), node.lineno)


def exists(dotted: str) -> bool:
    """Whether a dotted name that begins with a package leads to a module, and on to names that the module has."""
    first, _, rest = dotted.replace("chemage.plugin.", "chemage.", 1).partition(".")
    if first == "chemage" and (home := PUBLIC.get(rest.partition(".")[0])):
        dotted = ".".join([home, *([rest.partition(".")[0]] if home not in MODULES else []), *rest.split(".")[1:]])
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        if (path := MODULES.get(".".join(parts[:count]))) is not None:
            own = parts[count : count + 1]
            # a member of a class may be inherited, so that it is looked for in every module
            return all(name in defined(path) for name in own) and all(n in everywhere() for n in parts[count + 1 :])
    return False


PACKAGES = sorted({module.partition(".")[0] for module in MODULES})
DOTTED = re.compile(rf"(?<![\w/.-])((?:{'|'.join(PACKAGES)})(?:\.\w+)+)\b(?!/)")
ROLE = re.compile(r":(?:mod|func|class|data|meth|attr|exc):`~?([^`]+)`")
FILE = re.compile(rf"(?<![\w/])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")
PRIVATE = re.compile(r"(?<!`)``?(_[a-z]\w+)`")


def dead_in(text: str, path: Path) -> set[str]:
    """References in a text of a file that lead nowhere."""
    bad = {name for name in DOTTED.findall(text) if not exists(name)}
    for name in ROLE.findall(text):
        if name.partition(".")[0] not in PACKAGES and not set(name.split(".")) <= everywhere():
            bad.add(name)
    bad |= {name for name in FILE.findall(text) if not any((ROOT / name).parent.glob(f"{Path(name).name}*"))}
    if path.suffix == ".py" and (private := set(PRIVATE.findall(text))):
        beside = sorted(path.parent.glob("*.py"))
        private -= {one.stem for one in beside}.union(*map(defined, beside))
        # the end of other names, such as the columns *_stderr
        bad |= {name for name in private if not re.search(rf"\w{name}\b", path.read_text(encoding="utf-8"))}
    return bad


def dead(path: Path) -> list[str]:
    """References in the texts of a file that lead nowhere, with their lines."""
    if not dead_in(path.read_text(encoding="utf-8"), path):  # reading comments and docstrings apart takes seconds
        return []
    shown = path.relative_to(ROOT).as_posix()
    return [
        f"{shown}:{line}: {name}"
        for line, text in passages(path)
        for name in sorted(dead_in(text, path) - ABSENT.get(shown, set()))
    ]


@pytest.mark.parametrize("folder", [*FOLDERS, "texts"])
def test_what_is_referred_to_exists(folder):
    paths = TEXTS if folder == "texts" else [path for path in SOURCES if path.is_relative_to(ROOT / folder)]
    assert not (found := [line for path in paths for line in dead(path)]), "\n".join(found)


@pytest.mark.parametrize(
    "text",
    [
        "See :meth:`chemage.spec.Engine.expected`.",
        "see `_nowhere`",
        "tests/benchmarks/gone.py",
        ":mod:`chemage.foundation.gone`",
    ],
)
def test_a_dead_reference_is_found(text, tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    (tmp_path / "module.py").write_text(f'"""{text}"""\n')
    assert len(dead(tmp_path / "module.py")) == 1
