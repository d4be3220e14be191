"""What ``chemage infer`` stores: an inference, forecasts made with it, and planned measurements in their order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from chemage.foundation.records import Record
from chemage.foundation.text import jsonable
from chemage.inference.forecast import LEVELS, Forecast
from chemage.inference.inference import Inference

#: forecasts that one file can hold
MOST_FORECASTS = 100


@dataclass(frozen=True)
class InferenceResult:
    """An inference with what was asked of it."""

    inference: Inference
    #: label, as it was asked for -> forecast
    forecasts: Mapping[str, Forecast] = field(default_factory=dict)
    #: planned measurements, the best first; see :meth:`Inference.next_experiment`
    experiments: tuple[dict[str, Any], ...] = ()
    #: what they are to narrow, in words
    target: str = ""

    def parts(self) -> dict[str, Record]:
        """The objects to store, by group name."""
        forecasts = {f"forecast_{number}": one for number, one in enumerate(self.forecasts.values(), 1)}
        return {"inference": self.inference, **forecasts}

    def summary(self) -> dict[str, Any]:
        """One JSON-able object."""
        forecasts = [{"label": label, **_of_forecast(one)} for label, one in self.forecasts.items()]
        asked = {"forecasts": forecasts, "experiments": list(self.experiments), "target": self.target}
        return jsonable({**self.inference.summary(), **asked})


def _of_forecast(one: Forecast) -> dict[str, Any]:
    return {
        "load": one.load,
        "temperature": one.temperature,
        "hold_times": one.hold_times,
        "friction_drop": one.friction_drop,
        "median": one.median,
        "friction_coefficient_drop": one.friction_coefficient_drop,
        **{f"band_{100 * level:.0f}": list(one.band(level)) for level in LEVELS},
        "unseen": one.unseen,
        "notes": list(one.notes),
    }
