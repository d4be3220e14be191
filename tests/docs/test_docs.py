"""The documentation is true: its Python runs, its scenes are valid, its commands exist, its links lead somewhere."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

from chemage import parse_scene
from chemage.cli import app as command_line
from chemage.plugin import scene_data
from chemage.scene.scene import SECTIONS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: the tutorial's plugin is built and installed by a test of its own
TUTORIAL = ROOT / "docs" / "plugins.md"


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


def every(language):
    """Blocks of this language on every page."""
    return [block for page in PAGES for block in blocks(page) if block.language == language and page != TUTORIAL]


PYTHON = [page for page in PAGES if page != TUTORIAL and any(b.language == "python" for b in blocks(page))]


#: pages whose code computes for seconds
LONG = ("kinetics.md", "gallery.md", "comparing.md", "inference.md")


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


def test_scenes_are_valid():
    for block in every("toml"):
        try_scene(block)


def try_scene(block):
    """Make a scene of a block: of a whole one, or of some sections in the reference scene."""
    data = tomllib.loads(block.text)
    if not data.keys() <= set(SECTIONS):
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
    """Every ``chemage …`` of a shell block, with its place, as words."""
    found = []
    for page in PAGES:
        for block in blocks(page):
            if block.language not in ("sh", "bash", "console", "sh-session", "shell"):
                continue
            for number, line in enumerate(block.text.replace("\\\n", " ").splitlines(), block.line + 1):
                for part in re.split(r"&&|\|", line):
                    words = shlex.split(part.removeprefix("$ "), comments=True)
                    if words and Path(words[0]).name == "chemage":
                        found.append((f"{page.name}:{number}: {' '.join(words)}", words[1:]))
    return found


def test_commands_and_options_exist():
    lines, every_command = command_lines(), command_line._all_commands()
    assert len(lines) > 30
    for place, words in lines:
        command = every_command
        if words and words[0].startswith("-"):
            continue
        while hasattr(command, "commands"):
            name, *words = words
            assert name in command.commands, f"{place}: there is no command {name}"
            command = command.commands[name]
        options = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        used = {word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)}
        assert used <= options | {"--help", "-h"}, f"{place}: no such option: {used - options}"


def anchors(page):
    """The names that headings of a page can be linked by, as GitHub makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.replace("`", "").lower()).replace(" ", "-") for title in titles}


def problem_of(page, target):
    """What is wrong with a link of a page, if anything."""
    path, _, anchor = target.partition("#")
    goal = (page.parent / path).resolve() if path else page
    if not goal.exists() or not goal.is_relative_to(ROOT):
        return "leads nowhere in the project"
    return f"{goal.name} has no heading for #{anchor}" if anchor and anchor not in anchors(goal) else ""


def test_links_lead_somewhere():
    problems = [
        f"{page.name}: {target}: {problem}"
        for page in PAGES
        for target in dict.fromkeys(re.findall(r"\]\(([^)\s]+)[^)]*\)", page.read_text(encoding="utf-8")))
        if not re.match(r"[a-z]+:", target) and (problem := problem_of(page, target))
    ]
    assert problems == []


@pytest.mark.parametrize("target", ["nowhere.md", "plugins.md#no-such-heading", "../../outside.md"])
def test_a_dead_link_is_found(target):
    assert problem_of(ROOT / "docs" / "index.md", target)


def test_every_page_is_in_the_index():
    index = ROOT / "docs" / "index.md"
    linked = {(index.parent / target).resolve() for target in re.findall(r"\]\(([^)#\s]+)", index.read_text())}
    pages = set((ROOT / "docs").glob("*.md")) - {index}
    assert pages <= linked, f"not in the index: {sorted(page.name for page in pages - linked)}"


def test_figures_are_not_orphans():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    orphans = [p.name for p in (ROOT / "docs").rglob("*.png") if p.name not in text]
    assert not orphans


def test_the_page_of_checks_lists_every_check_as_its_docstring_says(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    import checks

    assert checks.PAGE.read_text(encoding="utf-8") == checks.text(), "run python docs/site/checks.py"
    assert all("| `" in line for line in checks.text().splitlines() if line.startswith("| `"))
