"""The site is complete: every page is in the navigation, and every public name, role, command, array and message of the
code is where a reader looks for it."""

from __future__ import annotations

import ast
import inspect
import re
import runpy
from functools import cache
from pathlib import Path

import pytest

import chemage as ca

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: public name -> the module that has it
NAMES = {
    **{name: ca for name in ca.__all__ if name not in ("__version__", "plugin")},
    **dict.fromkeys(ca.plugin.__all__, ca.plugin),
    **dict.fromkeys(ca.plugin.registry.current().offered("names"), ca),
}
SITE = runpy.run_path(str(DOCS / "site" / "generate.py"))
#: the public names that the reference can show, and what shows one
KNOWN, ENTRY = SITE["names"]()


def text(name):
    return (DOCS / name).read_text(encoding="utf-8")


def words(page, language):
    """The words in the fenced blocks that ``docs/site/generate.py`` fills in."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", text(page), re.MULTILINE | re.DOTALL)
    return " ".join(found).split()


def test_every_page_is_in_the_navigation_once():
    listed = re.findall(r"^ +- .*: (\S+\.md)$", text("site/mkdocs.yml"), re.MULTILINE)
    notebooks = [f"notebooks/{path.stem}.md" for path in (DOCS / "notebooks").glob("*.ipynb")]
    paper = [f"paper/{page.name}" for page in (ROOT / SITE["PACKAGES"]["paper"]).glob("*.md")]
    assert sorted(listed) == sorted([*(page.name for page in DOCS.glob("*.md")), *notebooks, *paper])


def test_every_public_name_is_in_the_reference_once():
    assert sorted(words("reference.md", "names")) == sorted(NAMES)


def undescribed(name):
    """What of a public name has no text: the name itself, or members of a class."""
    value = getattr(NAMES[name], name)
    if not (inspect.isclass(value) or inspect.isfunction(value)):  # the entry itself holds the text
        heading, *entry = ENTRY(name).strip().splitlines()
        shown = (
            heading.startswith((f"### `{name}`", f"### `{NAMES[name].__name__}.{name}`")) and len("".join(entry)) > 20
        )
        return [] if shown else [name]
    members = vars(value).items() if inspect.isclass(value) else ()
    public = [
        (f"{name}.{member}", inner)
        for member, inner in members
        if not member.startswith("_") and (inspect.isfunction(inner) or isinstance(inner, property))
    ]
    return [path for path, inner in [(name, value), *public] if not inspect.getdoc(inner)]


def test_every_public_name_has_an_entry_that_says_something():
    assert sorted(KNOWN) == sorted(NAMES)
    assert not [path for name in NAMES for path in undescribed(name)]


def test_every_role_is_in_the_catalogue():
    assert words("reference.md", "components") == [*ca.plugin.registry.current().roles, "plugin"]


def test_every_role_is_among_the_checks():
    # those of plugins have none beside those of every component
    assert words("reference.md", "checks") == ["component", *ca.plugin.registry.Registry(()).roles]


@cache
def filled_reference():
    return SITE["on_page_markdown"](text("reference.md"))


def test_the_reference_can_be_filled():
    filled = filled_reference()
    assert len(filled) > 2 * len(text("reference.md"))
    assert "## Further" not in filled  # nothing is installed that the page does not place
    assert not re.search(r"^```(names|components|commands|checks)$", filled, re.MULTILINE)


def test_every_option_in_the_catalogue_has_a_meaning():
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \| (.*) \|$", filled_reference(), re.M)
    assert len(rows) > 40
    assert not [name for name, _, _, meaning in rows if not meaning.strip()]


def test_the_file_format_lists_every_array_with_its_dimensions_and_unit():
    groups = {
        "surface": ca.Surface,
        "contact": ca.ContactSolution,
        "ageing": ca.Ageing,
        "lattice": ca.ReactionLattice,
        "history": ca.plugin.BondHistory,
    }
    page = text("file-format.md")
    for group, cls in groups.items():
        (section,) = re.findall(rf"^### {group}$(.*?)(?=^##|\Z)", page, re.MULTILINE | re.DOTALL)
        for name, (dims, unit, _) in cls.arrays.items():
            row = f"| `{cls.stored_names.get(name, name)}` | {', '.join(f'`{dim}`' for dim in dims)} | {unit or 1} |"
            assert row in section, f"{group}: {row}"
        for name in cls.model_fields:
            assert f"`{cls.stored_names.get(name, name)}`" in section, f"{group}: {name} is not described"


def strings():
    """Every text in the code of chemage and its plugins, with … for what is filled in, joined by line feeds."""

    def shown(node):
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else "…"
        return "".join(shown(part) for part in node.values) if isinstance(node, ast.JoinedStr) else "…"

    files = [*(ROOT / "chemage").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    return "\n".join(
        shown(node) for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant | ast.JoinedStr)
    )


@pytest.mark.long
def test_every_message_in_troubleshooting_exists():
    """The fixed parts of each message are in the code as they stand on the page."""
    known = strings()
    titles = re.findall(r"^### (.*)$", text("troubleshooting.md"), re.MULTILINE)
    messages = [message for title in titles for message in re.findall(r"`([^`]+)`", title)]
    assert len(messages) > 25
    parts = [(message, part.strip(" ,:;()[]=")) for message in messages for part in message.split("…")]
    missing = [(message, part) for message, part in parts if len(part) > 3 and part not in known]
    assert not missing


def test_the_citation_file_agrees_with_the_project():
    import tomllib

    import yaml

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"version: {project['version']}\n" in citation
    assert f"license: {project['license']}\n" in citation
    assert f"- name: {project['authors'][0]['name']}\n" in citation
    content = yaml.safe_load(citation)
    assert {"cff-version", "message", "title", "authors"} <= content.keys(), "required by the format"
    assert content["cff-version"] == "1.2.0"
    assert content["version"] == project["version"] == ca.__version__
    assert content["authors"] == [{"name": "The chemage developers"}], "an entity"
    (paper,) = content["references"]
    assert {"type", "title", "authors"} <= paper.keys()
    assert paper["doi"] == "10.1103/PhysRevE.98.023001"
