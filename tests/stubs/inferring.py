"""What tests of the inference reach inside: the model of errors, ranks, effective samples, verdicts."""

from __future__ import annotations

from chemage.foundation.result import Compared, Curve, result_of
from chemage.inference.calibrate import Calibration, _errors, _rank, calibrate
from chemage.inference.noise import LARGEST, NEAREST, RARE, SPREAD, WIDER, ErrorModel, Noise, State
from chemage.inference.open import effective, r_hat
from chemage.results.verdicts import verdict

drawn_errors, rank = _errors, _rank

__all__ = [
    "LARGEST", "NEAREST", "RARE", "SPREAD", "WIDER", "Calibration", "Compared", "Curve", "ErrorModel", "Noise",
    "State", "calibrate", "drawn_errors", "effective", "r_hat", "rank", "result_of", "verdict",
]  # fmt: skip


def fewer_sweeps(monkeypatch):
    """Make a calibration fast."""
    monkeypatch.setattr("chemage.inference.calibrate.SWEEPS", 200)
