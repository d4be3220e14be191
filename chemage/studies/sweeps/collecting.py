"""Collects what several processes have computed of a sweep: verifies every point, and writes the tables."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from chemage.studies.sweeps.result import SweepResult, load_sweep
from chemage.studies.sweeps.shares import PLACE, remedies


@dataclass(frozen=True)
class Collected:
    """What is in the folder of a sweep, after :func:`collect_sweep`."""

    #: the results
    result: SweepResult
    #: the numbers of points that are missing, or whose checksum does not fit
    missing: list[int]
    #: the numbers of points that failed
    failed: list[int]
    #: whether ``results.csv`` and ``results.h5`` were written: no point is missing
    written: bool
    #: values of ``points`` that compute what is missing or failed: shares of which each computes a part, if the points
    #: were divided into one number of shares; and, the last, the numbers of all these points
    points: list[str]
    #: whether other processes of this machine compute points at present
    computing: bool

    @property
    def complete(self) -> bool:
        """Whether every point is done."""
        return not self.missing and not self.failed


def collect_sweep(folder: str | Path) -> Collected:
    """Verify every point in the folder of a sweep, and write the tables ``results.csv`` and ``results.h5``.

    The tables are written if every point is done or failed; they equal those of one process that computes all points.

    Raises
    ------
    StoreError
        It is not the folder of a sweep, or it cannot be written.
    """
    result = load_sweep(folder)
    states = result.states()
    missing = [point for point, state in enumerate(states) if state in ("missing", "damaged")]
    failed = [point for point, state in enumerate(states) if state == "failed"]
    texts = remedies(result.store, sorted(missing + failed), result.digest, len(states))
    computing = result.store.is_locked()
    if not missing:
        result.write_tables()
    if not missing and not failed and not computing:
        shutil.rmtree(result.store.path / PLACE, ignore_errors=True)
        shutil.rmtree(result.store.path / ".parts", ignore_errors=True)
    return Collected(result, missing, failed, not missing, texts, computing)
