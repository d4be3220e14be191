"""Back from measured ageing to the density of barriers, and forward again to conditions that were not measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_inference.result import Inference as Inference

RESULTS = {
    "curve": "chemage_inference.curves:MeasuredCurve",
    "inference": "chemage_inference.result:Inference",
    "forecast": "chemage_inference.forecast:Forecast",
}

NAMES = {
    "Forecast": "chemage_inference.forecast:Forecast",
    "Inference": "chemage_inference.result:Inference",
    "MeasuredCurve": "chemage_inference.curves:MeasuredCurve",
    "UnexplainedError": "chemage_inference.result:UnexplainedError",
    "infer": "chemage_inference.infer:infer",
    "read_curves": "chemage_inference.curves:read_curves",
}

__getattr__ = lazy_attributes({"result": RESULTS})


@hookimpl
def chemage_results() -> dict[str, str]:
    """What its files hold."""
    return RESULTS


@hookimpl
def chemage_names() -> dict[str, str]:
    """What users import from ``chemage``."""
    return NAMES


@hookimpl
def chemage_cli() -> list[tuple[str, Any]]:
    """The command ``chemage infer``."""
    from chemage_inference.command import infer

    return [("infer", infer)]
