"""The command line says what the plan says, before a run and in its results."""

from __future__ import annotations

import json

import pytest

pytestmark = pytest.mark.filterwarnings("default::chemage.foundation.errors.PlanWarning")

LATE = ("--set", "fit.start=1e6", "--set", "fit.stop=1e7")
SAID = "beta will not be fitted: no hold time lies between 1e+06 and 1e+07 s"


def test_check_warns_and_leaves_with_0(command, small):
    done = command("check", small, *LATE)
    assert done.status == 0
    assert f"warning: {SAID}" in " ".join(done.out.split())
    told = json.loads(command("check", small, *LATE, "--json").out)
    assert any(SAID in note for note in told["notes"])


def test_what_is_hopeless_ends_check_and_run_with_2_and_one_sentence(command, small):
    changes = ("--set", 'contact.kind="hertz"')
    said = "contact 'hertz' needs a sphere, but this surface has no radius"
    for words in (("check",), ("run", "--no-figures")):
        done = command(words[0], small, *words[1:], *changes)
        assert done.status == 2
        assert said in done.err


def test_run_repeats_the_warnings_once_on_stderr(command, small):
    done = command("run", small, *LATE, "--no-figures", "--json")
    assert done.status == 0
    assert done.err.count(SAID) == 1
    told = json.loads(done.out)
    assert told["beta"]["value"] is None
    assert told["beta_reason"].startswith("no hold time lies between 1e+06 and 1e+07 s")


@pytest.mark.long
def test_a_fit_that_cannot_be_made_keeps_its_row(command, small, tmp_path):
    """In run, show, compare and report; nothing is nan."""
    shown = command("run", small, *LATE, "--no-figures", "-o", "late.h5").out
    command("run", small, "--no-figures", "-o", "fitted.h5")
    reason = "not fitted: no hold time lies between 1e+06 and 1e+07 s"
    for text in (shown, command("show", "late.h5").out, command("compare", "late.h5").out):
        words = " ".join(text.split())
        assert reason in words or "β not fitted" in words
        assert "nan" not in words
    both = json.loads(command("compare", "late.h5", "fitted.h5", "--json").out)["results"]
    assert [one["beta"]["value"] is None for one in both] == [True, False]
    assert both[0]["beta_reason"]
    assert both[1]["beta_reason"] is None
    assert command("report", "late.h5", "fitted.h5", "-o", "page.html").status == 0
    assert reason in " ".join((small.parent / "page.html").read_text(encoding="utf-8").split())


def test_a_sweep_warns_once_of_all_its_points(command, small):
    small.write_text(small.read_text(encoding="utf-8") + '\n[sweep]\n"hold.seed" = [0, 1, 2]\n', encoding="utf-8")
    checked = command("check", small, *LATE)
    assert " ".join(checked.out.split()).count(f"warning: {SAID}") == 1
    assert "at point 0 and similar at 2 more of 3" in " ".join(checked.out.split())
    done = command("run", small, *LATE, "-o", "folder")
    assert done.err.count(SAID) == 1
    words = " ".join(done.out.split())
    assert words.count("not fitted at points 0, 1, 2: no hold time lies") == 1
    table = (small.parent / "folder" / "results.csv").read_text(encoding="utf-8").splitlines()
    assert "beta_reason" in table[0]
    assert all("no hold time lies" in line for line in table[1:])
    refused = command("check", small, "--set", 'contact.kind="hertz"')
    assert refused.status == 2
    assert "needs a sphere" in refused.err
    assert "at point 0" in refused.err
