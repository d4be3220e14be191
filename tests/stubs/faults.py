"""Faults and limits that tests bring about inside chemage: the one place that knows where.

Each function takes pytest's ``monkeypatch``, which takes the fault away again.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from chemage.plugin import Scatter
from chemage.plugins import content
from chemage.results import comparison, drawing
from chemage.scene import plan
from chemage.scene import run as experiment
from chemage.studies import tasks
from chemage.studies.sweeps import display, running
from chemage_inference import families, sampling
from chemage_inference import infer as inference


def no_checksums(patch: pytest.MonkeyPatch) -> None:
    """Checksums of what hooks are given and answer cannot be made."""

    def refuse(*_):
        raise AssertionError("a checksum was made")

    patch.setattr(content, "checksum", refuse)


def interrupt_after(patch: pytest.MonkeyPatch, count: int) -> None:
    """Ctrl-C comes after this number of samples of an ensemble."""
    inner, calls = tasks.run, []

    def stopping(*given, **more):
        calls.append(given)
        if len(calls) > count:
            raise KeyboardInterrupt
        return inner(*given, **more)

    patch.setattr(tasks, "run", stopping)


def counted_samples(patch: pytest.MonkeyPatch) -> list:
    """A list that grows by each sample of an ensemble that is computed from now on."""
    inner, calls = tasks.run, []
    patch.setattr(tasks, "run", lambda *given, **more: calls.append(given) or inner(*given, **more))
    return calls


def other_version(patch: pytest.MonkeyPatch, version: str) -> None:
    """Samples come from a worker with another version of chemage."""
    inner = tasks.content_of

    def other(made, *more):
        return inner(replace(made, versions={**made.versions, "chemage": version}), *more)

    patch.setattr(tasks, "content_of", other)


def speed(patch: pytest.MonkeyPatch, slowness: float) -> None:
    """The machine takes this many times as long as that of reference."""
    patch.setattr(plan, "slowness", lambda: slowness)


def infer_by(patch: pytest.MonkeyPatch, function) -> None:
    """`chemage infer` computes with this."""
    patch.setattr(inference, "infer", function)


def run_by(patch: pytest.MonkeyPatch, change) -> None:
    """``change`` is called with each result of `chemage run`, before it is written."""
    inner = experiment.run

    def changed(*words, **options):
        result = inner(*words, **options)
        change(result)
        return result

    patch.setattr(experiment, "run", changed)


def fewer_samples(patch: pytest.MonkeyPatch) -> None:
    """Means and bands of an inference need fewer effective samples than users get."""
    patch.setattr(sampling, "ENOUGH", 60)
    patch.setattr(sampling, "AGREED", 1.1)
    patch.setattr(sampling, "SCALARS_AGREED", 1.1)
    patch.setattr(families, "SHORT_SWEEPS", 40)


def most_compared(patch: pytest.MonkeyPatch, count: int) -> None:
    """So many results fit into one table."""
    patch.setattr(comparison, "MOST", count)


def most_lines(patch: pytest.MonkeyPatch, count: int) -> None:
    """So many lines fit into one plot of a sweep."""
    patch.setattr(display, "MOST_LINES", count)


def interrupt_drawing(patch: pytest.MonkeyPatch) -> None:
    """Ctrl-C comes as figures are drawn."""

    def stop(*_, **__):
        raise KeyboardInterrupt

    patch.setattr(drawing, "figures", stop)


def many_points(patch: pytest.MonkeyPatch, count: int) -> None:
    """A sweep of more points than this is asked about."""
    patch.setattr(running, "MANY_POINTS", count)


def known_scatter(patch: pytest.MonkeyPatch, relative: float | None) -> None:
    """Surfaces of every maker scatter by this much."""
    patch.setattr("chemage.scene.display.scatter_of", lambda *_: Scatter(relative, "here"))
