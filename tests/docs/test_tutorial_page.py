"""The pages `docs/tutorial.md` and `docs/accuracy.md`: their commands run, and print what they show, on any processor.

Surface and contact agree to the last digit that is printed. The kinetics of one seed is another realisation where one
bit of the pressure differs ("Equal bytes" of docs/file-format.md), so that numbers with a 95 % half width h agree
within 2 sqrt(h1² + h2²), about four standard errors of their difference.
"""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import chemage as ca

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?")
#: rows of which the numbers are those of the kinetics
RANDOM = re.compile("friction|bonds per|mean shear|ageing rate|cut-off|scatter")


def rows(text: str) -> dict[str, str]:
    """Label -> value of the rows of a table, with their continuations."""
    found, label = {}, ""
    for line in text.splitlines():
        if match := re.match(r" (\S.*?)  +(\S.*)", line):
            label = match[1]
            found[label] = match[2].strip()
        elif label and line.startswith("    ") and line.strip():
            found[label] += " " + line.strip()
        else:
            label = ""
    return found


def paragraphs(text: str) -> list[str]:
    """What is printed beside a table, without its line breaks."""
    parts = re.split(r"\n\s*\n", text)
    return [" ".join(part.split()) for part in parts if not rows(part)]


def words(text: str) -> str:
    return NUMBER.sub("#", text)


def numbers(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(text)]


def half_width(text: str) -> float:
    """Half the width of the 95 % interval of ``a ± b`` or ``a [low, high]``."""
    if match := re.search(r"± ([\d.]+)", text):
        return float(match[1])
    low, high = re.search(r"\[(\S+), (\S+)\]", text).groups()
    return 0.5 * (float(high) - float(low))


def agrees(label: str, shown: str, printed: str, drop: float) -> bool:
    """Whether a printed value agrees with the one of the page; ``drop``: relative tolerance of the friction drop."""
    (a, *_), (b, *_) = known = numbers(shown), numbers(printed)
    if not RANDOM.match(label):
        units = [10.0 ** -len(number.partition(".")[2]) for number in NUMBER.findall(shown)]
        return all(abs(one - two) <= 1.01 * unit for one, two, unit in zip(*known, units, strict=True))
    if label.startswith("mean shear"):
        return all(abs(one - two) <= drop * one + 1 for one, two in zip(*known, strict=True))
    if label.startswith("scatter"):  # of few surfaces
        return all(0.25 < one / two < 4 for one, two in zip(*known, strict=True))
    return abs(a - b) <= 2 * math.hypot(half_width(shown), half_width(printed))


def check(shown: str, printed: str) -> list[str]:
    """What of a printed table is not as the page shows it."""
    table, there = rows(printed), rows(shown)
    drops = [one[name] for one in (table, there) for name in one if name.startswith("friction drop")]
    drop = 2 * math.hypot(*(half_width(one) / numbers(one)[0] for one in drops)) if drops else 0.0
    return [
        f"{label}: {value} | {table.get(label)}"
        for label, value in there.items()
        if label not in table
        or words(value) != words(table[label])
        or (numbers(value) and not agrees(label, value, table[label], drop))
    ]


def test_a_number_beyond_its_error_is_found():
    shown = " ageing rate per decade β  0.430 [0.427, 0.432] over 13 hold times\n sites  61533\n"
    assert check(shown, shown.replace("0.430 [0.427, 0.432]", "0.431 [0.427, 0.435]")) == []
    assert check(shown, shown.replace("0.430 [0.427, 0.432]", "0.442 [0.439, 0.445]")) != []
    assert check(shown, shown.replace("61533", "61535")) != []
    assert check(shown, shown.replace("hold times", "replicas")) != []


def steps(page: str) -> list[tuple[str, str]]:
    """Each command, and what the page shows of its output; "" where it shows nothing."""
    step = r"```sh\n(chemage (?:run|compare) [^\n]*)\n```(?:\n\n(?:It prints[^\n]*\n\n)?```text\n(.*?)```)?"
    return re.findall(step, page, re.DOTALL)


@pytest.mark.long
@pytest.mark.parametrize(("name", "count"), [("tutorial", 5), ("accuracy", 1)])
def test_the_page_shows_what_its_commands_print(name, count, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    assert len(steps(page)) == count
    wrong = []
    for words_, shown in steps(page):
        done = command(*shlex.split(words_)[1:])
        assert done.status == 0, done.err
        printed = done.out + done.err
        wrong += check(shown, printed)
        all_words = words(" ".join(printed.split()))
        wrong += [part for part in paragraphs(shown) if words(part) not in all_words]
    assert not wrong, "\n".join(wrong)
    if name != "tutorial":
        return
    ageing = ca.read("silica-rough.h5").ageing
    texts = re.search(
        r"is (\S+) after 10 s, (\S+) after 100 s and (\S+) after 1000 s", page.replace("\n", " ")
    ).groups()
    for time, text in zip((10, 100, 1000), texts, strict=True):
        at = int(np.argmin(abs(ageing.hold_times - time)))
        half = ageing.friction_coefficient_drop_half_width[at]
        assert ageing.mean_friction_coefficient_drop[at] == pytest.approx(
            float(text), abs=2 * math.sqrt(2) * half + 0.005
        )
