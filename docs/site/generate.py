"""Fill the reference page when the site is built: a hook of MkDocs, named in mkdocs.yml.

Four kinds of fenced block are replaced:

- ``names``: public names of ``chemage`` and ``chemage.plugin``. Each becomes an entry made from its docstring, wherever
  the object is defined.
- ``components``: roles. Each becomes the list of installed components of that role, with a table of their options;
  ``plugin``, the list of plugins with options.
- ``commands``: commands of ``chemage``. Each becomes its help text and a table of its options.
- ``checks``: roles, and ``component`` for what holds for all. Each becomes the table of its checks.

What is installed but named in no block is appended to its page, so that nothing goes missing.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import typer
from typer.testing import CliRunner

import chemage
from chemage.cli import app as command_line
from chemage.foundation.checks import meanings
from chemage.foundation.names import HOME, USERS, load
from chemage.foundation.records import Record
from chemage.plugins import registry
from chemage.testing.checks import CHECKS, Check

sys.path.insert(0, str(Path(__file__).parent))
from notebooks import markdown

#: names of chemage that its plugins bring -> "module:object"
BROUGHT = registry.current().offered("names")
#: folder of the site -> the pages and pictures of a package beside chemage
PACKAGES = {"paper": "plugins/chemage_li2018/docs"}
ROOT = Path(__file__).parents[2]

BLOCK = re.compile(r"^```(names|components|commands|checks)$", re.MULTILINE)
#: a letter with a subscript, and a power, as the pages write them in plain text
SYMBOL = re.compile(r"(?<!\w)([^\W\d_]'?)_((?:rms|intrinsic|form|break|in|[NLrsBbcnpi])(?:,i)?)(?!\w)")
POWER = re.compile(r"\^\(([^()]*)\)")
ROLE = re.compile(r":(?:class|func|meth|attr|mod|exc|data):")


def on_files(files: Any, config: Any) -> Any:
    """Add each notebook as a page, and the pages of packages."""
    from mkdocs.structure.files import File

    for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=markdown(path)))
    for folder, package in PACKAGES.items():
        for path in sorted(file for file in (ROOT / package).rglob("*") if file.is_file()):
            name = path.relative_to(ROOT / package).as_posix()
            files.append(File.generated(config, f"{folder}/{name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace the fenced blocks of a page; links to notebooks and to packages lead to their pages, and back."""
    markdown = re.sub(r"\]\(notebooks/(\w+)\.ipynb\)", r"](notebooks/\1.md)", markdown)
    for folder, package in PACKAGES.items():
        markdown = markdown.replace(f"](../{package}/", f"]({folder}/")
    markdown = markdown.replace("](../../../docs/", "](../")
    for language in dict.fromkeys(BLOCK.findall(markdown)):
        markdown = _filled(markdown, language)
    return markdown


def _filled(page: str, language: str) -> str:
    """The page with its blocks of one language replaced, and at its end what none of them names."""
    known, entry = SOURCES[language]()
    block = re.compile(rf"^```{language}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
    named = {word for words in block.findall(page) for word in words.split()}
    if unknown := sorted(named - set(known)):
        raise ValueError(f"no such {language}: {', '.join(unknown)}; there are: {', '.join(known)}")
    page = block.sub(lambda found: "\n".join(entry(word) for word in found[1].split()), page)
    if further := [word for word in known if word not in named]:
        page += "\n".join([f"\n## Further {language}\n", *(entry(word) for word in further)])
    return page


def on_post_build(config: Any, **_: Any) -> None:
    """Write a page for each old name, which leads to the page that has its content now."""
    for old, new in config.extra["redirects"].items():
        page = f'<!doctype html><meta http-equiv="refresh" content="0; url={new}"><a href="{new}">{new}</a>\n'
        (Path(config.site_dir) / f"{old}.html").write_text(page, encoding="utf-8")


def on_page_content(html: str, **_: Any) -> str:
    """Show cross-references of docstrings (``:func:`chemage.age```) as plain code, and set symbols such as q_L."""
    pieces, inside = re.split(r"(<[^>]+>)", ROLE.sub("", html)), 0
    for number, piece in enumerate(pieces):
        if re.match(r"</?(code|pre)\b", piece):
            inside += -1 if piece.startswith("</") else 1
        elif not inside and not piece.startswith("<"):
            pieces[number] = POWER.sub(r"<sup>\1</sup>", SYMBOL.sub(r"\1<sub>\2</sub>", piece))
    return "".join(pieces)


# -- public names -----------------------------------------------------------------------------------------------------


def names() -> tuple[list[str], Callable[[str], str]]:
    """The public names, and the Markdown of one."""
    offered = {*chemage.__all__, *chemage.plugin.__all__, *BROUGHT} - {"__version__", "plugin"}
    return sorted(offered), _name


def _place(name: str) -> str:
    return f"chemage.{name}" if name in {*USERS, *BROUGHT} else f"chemage.plugin.{name}"


def _name(name: str) -> str:
    thing = load(name, BROUGHT.get(name, ""))
    if inspect.ismodule(thing):
        return _module(name, thing)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        return _documented(thing, _place(name), name)
    return f"### `{name}` {{ #{_place(name)} }}\n\n{_about(name, thing)}\n"


def _documented(thing: Any, heading: str, label: str, level: int = 3) -> str:
    """The entry that mkdocstrings makes of the docstring, where the object is defined."""
    options = f"    options:\n      heading: {heading}\n      toc_label: {label}\n      heading_level: {level}\n"
    # of a role, also the methods that a plugin defines and users do not call, such as _solve
    if defined := [name for name in sorted(getattr(thing, "__abstractmethods__", ())) if name.startswith("_")]:
        options += f"      filters: ['!^_(?!{'|'.join(name[1:] for name in defined)}$)']\n"
    thing = inspect.unwrap(thing)  # where it is defined
    return f"::: {thing.__module__}.{thing.__qualname__}\n{options}\n{_fields(thing)}"


def _fields(thing: Any) -> str:
    """A table of the fields of a record, or of a class that a component receives: name and meaning."""
    if not (inspect.isclass(thing) and (issubclass(thing, Record) or dataclasses.is_dataclass(thing))):
        return ""
    source, texts = inspect.getsource(thing), meanings(thing) if issubclass(thing, Record) else {}
    names = thing.model_fields if issubclass(thing, Record) else [field.name for field in dataclasses.fields(thing)]
    rows = []
    for name in names:
        comment = re.search(rf"((?:^    #: .*\n)+)    {name}:", source, re.MULTILINE)
        text = texts.get(name) or (comment[1].replace("    #: ", "").strip() if comment else "")
        rows.append([f"`{name}`", plain(text)])
    return table(("field", "meaning"), rows) + "\n"


def _module(name: str, module: Any) -> str:
    """A public module: its own text, then its functions and classes, except those that are names of ``chemage``."""
    first, *rest = (inspect.getdoc(module) or "").split("\n\n")
    trees = [f"```text\n{text}\n```" for text in rest if "──" in text]
    parts = [f"### `{_place(name)}` {{ #{_place(name)} }}", plain(first), *trees]
    others = [inspect.unwrap(load(other)) for other in HOME]
    for inner in getattr(module, "__all__", vars(module)):
        thing = getattr(module, inner)
        function = getattr(thing, "py_func", thing)  # of a kernel
        if inner.startswith("_") or not (inspect.isclass(function) or inspect.isfunction(function)):
            continue
        elsewhere = any(inspect.unwrap(thing) is other for other in others)
        if elsewhere or not function.__module__.startswith(module.__name__):
            continue
        place = f"{_place(name)}.{inner}"
        if "<locals>" in function.__qualname__:  # made by another function
            parts.append(f"#### `{place}` {{ #{place} }}\n\n{plain(inspect.getdoc(function) or '')}")
        else:
            parts.append(_documented(function, place, inner, 4))
    return "\n\n".join(parts) + "\n"


def _about(name: str, value: Any) -> str:
    """A public name that is neither function, class nor module: a quantity, or what the comment above it says."""
    unit = next((part for part in getattr(value, "__metadata__", ()) if isinstance(part, chemage.plugin.Unit)), None)
    if unit is not None:
        bounds = {"gt": "greater than", "ge": "at least", "lt": "less than", "le": "at most"}
        limits = [f"{bounds[bound]} {limit:g}" for bound, limit in unit._bounds.items()]
        text = f"The type of an option that is a quantity in {unit.unit.replace('**3', '³')}"
        return f"{', '.join([text, *limits])}. A string carries its own unit."
    source = inspect.getsource(importlib.import_module(f"chemage.{HOME[name]}"))
    if comment := re.search(rf"((?:^#: .*\n)+){name} = ", source, re.MULTILINE):
        text = " ".join(line.removeprefix("#: ") for line in comment[1].splitlines())
        shown = f" Its value is `{value!r}`." if isinstance(value, float | int | tuple) else ""
        return f"{text[0].upper()}{text[1:].rstrip('.')}.{shown}"
    return (inspect.getdoc(type(value)) or "").split("\n\n")[0]  # an instance is documented by its class


# -- components -------------------------------------------------------------------------------------------------------


def components() -> tuple[list[str], Callable[[str], str]]:
    """The roles that have components, and the Markdown of one role."""
    found = _called("plugins", "list", "--json")
    installed = found["components"]
    roles = [*dict.fromkeys(row["role"] for row in installed), "plugin"]

    def role(name: str) -> str:
        if name == "plugin":
            named = [_component(name, plugin) for plugin in found["options"]]
            return "\n".join(named) or "None of the installed plugins has options."
        kinds = dict.fromkeys(row["kind"] for row in installed if row["role"] == name)
        return "\n".join(_component(name, kind) for kind in kinds)

    return roles, role


def _component(role: str, kind: str) -> str:
    (shown,) = [row for row in _called("plugins", "show", kind, "--json") if row["role"] == role]
    parts = [f"#### `{kind}`", plain(shown["about"])]
    if shown["options"]:
        keys = ("name", "unit", "default", "meaning")
        rows = (
            [f"`{row['name']}`", row["unit"], _default(row["default"]), plain(row["meaning"])]
            for row in shown["options"]
        )
        parts.append(table(keys, rows))
    else:
        parts.append("No options.")
    if shown["cite"]:
        parts.append("Cite: " + "; ".join(shown["cite"]) + ".")
    return "\n\n".join(parts) + "\n"


def _default(text: str) -> str:
    return text if text == "required" else f"`{text}`"


def _called(*words: str) -> Any:
    """What a command of chemage prints with ``--json``."""
    done = CliRunner().invoke(command_line.app, list(words))
    if done.exit_code:
        raise RuntimeError(f"chemage {' '.join(words)}: {done.output}") from done.exception
    return json.loads(done.stdout)


# -- commands ---------------------------------------------------------------------------------------------------------


def commands() -> tuple[list[str], Callable[[str], str]]:
    """The commands, those of plugins included, and the Markdown of one."""
    command_line._add_plugin_commands()
    found: dict[str, Any] = {}

    def collect(command: Any, path: str) -> None:
        if not hasattr(command, "commands"):
            found[path.replace(" ", "-")] = (path, command)
        for name, inner in getattr(command, "commands", {}).items():
            collect(inner, f"{path} {name}".strip())

    collect(typer.main.get_command(command_line.app), "")
    return list(found), lambda name: _command(*found[name])


def _command(path: str, command: Any) -> str:
    arguments, options = [], []
    for parameter in command.params:
        if parameter.name == "help":
            continue
        about = plain(" ".join((getattr(parameter, "help", None) or "").split()))
        if parameter.param_type_name == "argument":
            arguments.append((f"`{parameter.metavar or parameter.name.upper()}`", about))
        else:
            spellings = [*parameter.opts, *parameter.secondary_opts]
            options.append((", ".join(f"`{one}`" for one in spellings), about))
    parts = [f"### `chemage {path}`", plain(inspect.cleandoc(command.help or ""))]
    if arguments:
        parts.append(table(("argument", "meaning"), arguments))
    if options:
        parts.append(table(("option", "meaning"), options))
    return "\n\n".join(parts) + "\n"


# -- checks -----------------------------------------------------------------------------------------------------------


def checks() -> tuple[list[str], Callable[[str], str]]:
    """The roles, and the Markdown of the checks of one."""

    def role(name: str) -> str:
        rows = []
        classes = sorted(CHECKS["" if name == "component" else name], key=lambda one: one.last)
        for check in (Check(method, of, {}) for of in classes for method in of.names()):
            also = f" Needs {' and '.join(f'`{need}=`' for need in check.missing)}." if check.missing else ""
            rows.append((f"`{check.name}`", plain(check.requirement) + also))
        title = "Every component" if name == "component" else f"Role `{name}`"
        return f"### {title}\n\n{table(('check', 'requirement'), rows)}\n"

    return ["component", *(one for one in chemage.plugin.registry.current().roles if one in CHECKS)], role


# -- shared -----------------------------------------------------------------------------------------------------------


def plain(text: str) -> str:
    """A docstring as Markdown."""
    return ROLE.sub("", inspect.cleandoc(text)).replace("``", "`")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    lines = [list(head), *([cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


SOURCES: dict[str, Callable[[], tuple[list[str], Callable[[str], str]]]] = {
    "names": names,
    "components": components,
    "commands": commands,
    "checks": checks,
}
