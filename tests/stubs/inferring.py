"""What tests of the inference reach inside: the model of errors, ranks, effective samples, verdicts."""

from __future__ import annotations

from chemage.ageing.covariance import CurveError
from chemage.foundation import algebra
from chemage.foundation.quantities import Curve, by_name
from chemage.foundation.result import Comparable, result_of
from chemage.results.verdicts import between, verdict
from chemage_inference.calibrate import Calibration, _errors, _rank, calibrate
from chemage_inference.forward import make_model
from chemage_inference.infer import _error_terms
from chemage_inference.noise import LARGEST, NEAREST, RARE, SPREAD, WIDER, ErrorModel, Noise, State
from chemage_inference.open import effective, r_hat
from chemage_inference.problem import Prior, Problem, unknowns_of
from chemage_inference.sampling import Chain, warm

drawn_errors, error_terms, rank = _errors, _error_terms, _rank

__all__ = [
    "LARGEST", "NEAREST", "RARE", "SPREAD", "WIDER", "Calibration", "Chain", "Comparable", "Curve", "CurveError",
    "ErrorModel", "Noise", "Prior", "Problem", "State", "algebra", "between", "by_name", "calibrate", "drawn_errors",
    "effective", "error_terms", "make_model", "r_hat", "rank", "result_of", "unknowns_of", "verdict", "warm",
]  # fmt: skip


def fewer_sweeps(monkeypatch):
    """Make a calibration fast."""
    monkeypatch.setattr("chemage_inference.calibrate.SWEEPS", 200)


def few_effective(monkeypatch):
    """End sampling at a third of the effective samples that are usual."""
    monkeypatch.setattr("chemage_inference.sampling.ENOUGH", 100)
    for name in ("AGREED", "SCALARS_AGREED"):
        monkeypatch.setattr(f"chemage_inference.sampling.{name}", 1.06)
