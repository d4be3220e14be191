"""Whatever is given to whatever is public: an answer in finite numbers, or an error of chemage. No signal, no hang.

The calls are made in a process of their own, so that one that ends the interpreter is seen. ``CHEMAGE_FUZZ`` sets how
many are made with ``--long``; case n is the same everywhere, and ``python tests/stubs/hostile.py n n+1`` makes it
again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HOSTILE = Path(__file__).parents[1] / "stubs" / "hostile.py"
CASES = int(os.environ.get("CHEMAGE_FUZZ", "700"))
#: of these, in the quick run
QUICK, MORE = min(12, CASES), min(120, CASES)
#: where one process ends and the next begins, so that a crash costs few cases
BATCH = 3000


def bad_ends(first, last):
    """What went wrong in the cases from ``first`` to ``last`` - 1, by number."""
    found = {}
    while first < last:
        command = [sys.executable, str(HOSTILE), str(first), str(min(first + BATCH, last))]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        found |= {line["number"]: line["wrong"] for line in lines if "wrong" in line}
        begun = [line["begin"] for line in lines if "begin" in line]
        if any("done" in line for line in lines):
            first = min(first + BATCH, last)
        elif begun:  # ended by a signal, or hung
            found[begun[-1]] = f"the process ended with {done.returncode}\n{done.stderr[-3000:]}"
            first = begun[-1] + 1
        else:
            raise RuntimeError(done.stderr)
        if len(found) > 20:
            break
    return found


OBJECTS = Path(__file__).parents[1] / "benchmarks" / "hostile_objects.py"


@pytest.mark.parametrize(
    ("first", "last"),
    [(0, 10), pytest.param(10, 120, marks=pytest.mark.long), pytest.param(120, 700, marks=pytest.mark.campaign)],
)
def test_every_public_function_answers_or_refuses_every_object(first, last, tmp_path):
    command = [sys.executable, str(OBJECTS), str(first), str(last)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    wrong = [line for line in done.stdout.splitlines() if line.startswith("{")][:-1]
    assert done.returncode == 0, "\n\n".join(wrong) or done.stderr


@pytest.mark.parametrize(
    ("first", "last"),
    [
        (0, QUICK),
        pytest.param(QUICK, MORE, marks=pytest.mark.long),
        pytest.param(MORE, CASES, marks=pytest.mark.campaign),
    ],
)
def test_no_input_ends_in_a_signal_a_traceback_a_hang_or_numbers_that_are_none(first, last):
    found = bad_ends(first, last)
    assert not found, "\n\n".join(f"case {number}: {wrong}" for number, wrong in found.items())
