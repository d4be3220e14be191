"""Notebooks are what their sources give: equal code, and numbers that agree within their stated errors."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
SCRIPT = runpy.run_path(str(DOCS / "site" / "notebooks.py"))
NAMES = sorted(path.stem for path in (DOCS / "notebooks").glob("*.py"))
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def stored(name):
    return json.loads((DOCS / "notebooks" / f"{name}.ipynb").read_text(encoding="utf-8"))


def numbers(notebook):
    """(value, error) of every number in the texts and tables of a notebook; the error is 0 where none is stated."""
    texts = [text for kind, text in SCRIPT["outputs"](notebook) if kind != "image/png"]
    # the time that something took is no result
    texts = [re.sub(r"<[^>]*>", " ", re.sub(r"wall time</td>.*?</tr>", "", text)) for text in texts]
    found = []
    for value, error, low, high in re.findall(
        rf"(?<![\w.])({NUMBER})(?:\s*±\s*({NUMBER})|\s*\[({NUMBER}), ({NUMBER})\])?", "\n".join(texts)
    ):
        found.append((float(value), float(error) if error else (float(high) - float(low)) / 2 if low else 0.0))
    return found


def test_there_are_notebooks():
    assert len(NAMES) >= 2
    assert {path.stem for path in (DOCS / "notebooks").glob("*.ipynb")} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_holds_the_code_of_its_source_and_is_small(name):
    file = DOCS / "notebooks" / f"{name}.ipynb"
    source = (DOCS / "notebooks" / f"{name}.py").read_text(encoding="utf-8")
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in stored(name)["cells"]]
    assert cells == list(SCRIPT["cells"](source)), "run docs/site/notebooks.py"
    assert file.stat().st_size < 300_000
    outputs = list(SCRIPT["outputs"](stored(name)))
    assert outputs
    assert not [text for _, text in outputs if "Traceback" in text or "/home/" in text or "/tmp/" in text]
    page = SCRIPT["markdown"](file)
    assert page.startswith("# ")
    assert "```python" in page
    assert 'class="output"' in page


def test_numbers_are_read_with_their_errors():
    one = {"cells": [{"outputs": [{"text": ["beta = 1.5 ± 0.2, t [s] 2.0 [1.0, 3.5] and 7e-3"]}]}]}
    assert numbers(one) == [(1.5, 0.2), (2.0, 1.25), (7e-3, 0.0)]


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.campaign if name == "job_array" else pytest.mark.long) for name in NAMES],
)
def test_a_notebook_gives_its_numbers_again(name):
    source = (DOCS / "notebooks" / f"{name}.py").read_text(encoding="utf-8")
    before, now = numbers(stored(name)), numbers(SCRIPT["executed"](source))
    assert len(before) == len(now) > 10
    for (old, error), (new, _) in zip(before, now, strict=True):
        # numbers without an error are exact, or means whose error stands elsewhere: 5 % are above it here
        assert new == pytest.approx(old, abs=error, rel=0.0 if error else 0.05)
