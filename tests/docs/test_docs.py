"""The documentation is true: its Python runs, its scenes are valid, its commands exist, its links lead somewhere."""

from __future__ import annotations

import csv
import re
import shlex
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

from chemage import parse_scene
from chemage.cli import app as command_line
from chemage.plugin import scene_data
from chemage.scene.files import section_names

ROOT = Path(__file__).parents[2]
#: of the framework, and of packages beside it
FOLDERS = [ROOT / "docs", *sorted(ROOT.glob("plugins/*/docs"))]
PAGES = [ROOT / "README.md", *(page for folder in FOLDERS for page in sorted(folder.rglob("*.md")))]
#: the tutorial's plugin is built and installed by a test of its own
TUTORIAL = ROOT / "docs" / "plugins.md"


LINK = r"\]\((?![a-z]+:)([^)\s]+)[^)]*\)"


class Block(NamedTuple):
    """A fenced block."""

    page: Path
    line: int
    language: str
    text: str


def blocks(page):
    """The fenced blocks of a page."""
    found, start, fence, language, lines = [], 0, "", "", []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        opening = re.match(r"( *)(```+)([\w-]*)", line)
        if not fence and opening:
            start, fence, language, lines = number, opening[1] + opening[2], opening[3], []
        elif fence and line.rstrip() == fence:
            found.append(Block(page, start, language, "\n".join(lines) + "\n"))
            fence = ""
        elif fence:
            lines.append(line)
    assert not fence, f"{page.name}:{start}: the block is never closed"
    return found


def every(*languages):
    """Blocks of these languages on every page, as test parameters."""
    return [
        pytest.param(block, id=f"{block.page.name}:{block.line}")
        for page in PAGES
        for block in blocks(page)
        if block.language in languages and page != TUTORIAL
    ]


PYTHON = [page for page in PAGES if page != TUTORIAL and any(b.language == "python" for b in blocks(page))]


#: pages whose code computes for seconds
LONG = ("kinetics.md", "gallery.md", "sweeps.md", "inference.md", "contact.md", "pulling.md")


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.name, marks=pytest.mark.long if page.name in LONG else ()) for page in PYTHON],
)
def test_python_runs_as_written(page, tmp_path, monkeypatch, capsys):
    """The blocks of one page, one after the other, in one namespace and an empty folder."""
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": "docs"}
    for block in blocks(page):
        if block.language == "python":
            # empty lines before it, so that a traceback names the line of the page
            code = compile("\n" * block.line + block.text, str(page), "exec")
            exec(code, namespace)


def test_the_readme_shows_python():
    assert ROOT / "README.md" in PYTHON


@pytest.mark.parametrize("block", every("toml"))
def test_scenes_are_valid(block):
    data = tomllib.loads(block.text)
    if not data.keys() <= set(section_names()):
        return  # another kind of file, such as pyproject.toml
    data.pop("sweep", None)
    if {"surface", "contact"} <= data.keys():
        parse_scene(data, f"{block.page.name}:{block.line}")
        return
    # some sections alone: they must fit the reference scene
    base = scene_data("silica-rough")[0]
    for section, part in data.items():
        same = isinstance(part, dict) and part.get("kind") in (None, base.get(section, {}).get("kind"))
        base[section] = {**base.get(section, {}), **part} if same else part
    base["contact"].setdefault("load", "20 uN")
    parse_scene(base, f"{block.page.name}:{block.line}")


def command_lines():
    """Every ``chemage …`` of a shell block: where it is -> its words."""
    found = {}
    for page in PAGES:
        for block in blocks(page):
            if block.language not in ("sh", "bash", "console", "sh-session", "shell"):
                continue
            for number, line in enumerate(block.text.replace("\\\n", " ").splitlines(), block.line + 1):
                for part in re.split(r"&&|\|", line):
                    words = shlex.split(part.removeprefix("$ "), comments=True)
                    if words and Path(words[0]).name == "chemage":
                        found[f"{page.name}:{number}: {' '.join(words)}"] = words[1:]
    return found


def wrong_in(words):
    """The names in a command line that chemage does not have."""
    command = command_line._all_commands()
    if words and words[0].startswith("-"):
        return set()
    while hasattr(command, "commands"):
        name, *words = words
        if name not in command.commands:
            return {name}
        command = command.commands[name]
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    used = {word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)}
    return used - known - {"--help", "-h"}


def test_commands_and_options_exist():
    lines = command_lines()
    assert len(lines) > 50
    assert not {where: wrong for where, words in lines.items() if (wrong := wrong_in(words))}
    assert wrong_in(["runn", "silica-tip"]) == {"runn"}
    assert wrong_in(["run", "silica-tip", "--looad"]) == {"--looad"}


def anchors(page):
    """The names that headings of a page can be linked by, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.replace("`", "").lower()).replace(" ", "-") for title in titles}


def dead_end(page, target):
    """Why a link leads nowhere, or an empty text."""
    path, _, anchor = target.partition("#")
    goal = (page.parent / path).resolve() if path else page
    if not goal.exists() or not goal.is_relative_to(ROOT):
        return "no such file in the project"
    return f"no heading for #{anchor}" if anchor and anchor not in anchors(goal) else ""


def test_links_lead_somewhere():
    links = [(page, target) for page in PAGES for target in re.findall(LINK, page.read_text(encoding="utf-8"))]
    assert len(links) > 200
    dead = [f"{page.name}: {target}: {why}" for page, target in links if (why := dead_end(page, target))]
    assert not dead, "\n".join(dead)
    assert dead_end(ROOT / "README.md", "docs/gone.md")
    assert dead_end(ROOT / "README.md", "docs/index.md#gone")


def test_every_page_is_in_the_index():
    index = ROOT / "docs" / "index.md"
    linked = {(index.parent / target).resolve() for target in re.findall(r"\]\(([^)#\s]+)", index.read_text())}
    pages = {page for folder in FOLDERS for page in folder.glob("*.md")} - {index}
    assert pages <= linked, f"not in the index: {sorted(page.name for page in pages - linked)}"


def test_figures_are_not_orphans():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    orphans = [p.name for folder in FOLDERS for p in folder.rglob("*.png") if p.name not in text]
    assert not orphans


def test_every_table_of_measurements_is_linked_and_says_where_it_is_from():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    for path in [*(ROOT / "docs" / "data").iterdir()]:
        assert f"data/{path.name}" in text, f"no page links to {path.name}"
        if path.suffix == ".csv" and path.name != "tip.csv":  # an example of input
            _, made, _, *rows = path.read_text(encoding="utf-8").splitlines()
            assert re.match(r"# made by: (python tests/benchmarks/|chemage )", made), path.name
            assert len({len(row) for row in csv.reader(rows)}) == 1, f"{path.name} is no table"
            assert all(word == "python" or (ROOT / word).exists() for word in made.split()[3:5] if "/" in word)


def test_old_names_of_pages_lead_to_pages():
    yml = (ROOT / "docs" / "site" / "mkdocs.yml").read_text(encoding="utf-8")
    moved = re.findall(r"^    (\w+): (\S+)\.html(#\S+)?$", yml, re.MULTILINE)
    assert len(moved) >= 6
    for old, page, anchor in moved:
        assert not (ROOT / "docs" / f"{old}.md").exists()
        page = page.replace("paper/", "../plugins/chemage_li2018/docs/")
        assert not dead_end(ROOT / "docs" / "index.md", f"{page}.md{anchor}"), old
