"""The file of ``chemage infer``: an inference with its forecasts. :func:`chemage.read` reads the inference from it."""

from __future__ import annotations

import json
import os
from pathlib import Path

from chemage.foundation.codec import read_records, write_records
from chemage.foundation.errors import StoreError
from chemage.foundation.records import Record
from chemage.inference.forecast import Forecast
from chemage.inference.result import MOST_FORECASTS, Inference, InferenceResult

_FORECASTS = [f"forecast_{number}" for number in range(1, MOST_FORECASTS + 1)]
_CLASSES: dict[str, type[Record]] = {"inference": Inference, **dict.fromkeys(_FORECASTS, Forecast)}


def write_inference(path: str | os.PathLike[str], made: InferenceResult, *, force: bool = False) -> None:
    """Write an inference with its forecasts and planned measurements.

    Raises
    ------
    StoreError
        ``path`` exists (unless ``force``), or cannot be written; nothing is left behind.
    """
    about = {"labels": list(made.forecasts), "experiments": list(made.experiments), "target": made.target}
    write_records(path, made.parts(), {"asked": json.dumps(about)}, force=force)


def read_inference(path: str | os.PathLike[str]) -> InferenceResult:
    """The inverse of :func:`write_inference`; of a file with an inference alone, that.

    Raises
    ------
    StoreError
        The file is missing, damaged, or holds no inference.
    """
    source = Path(path)
    parts, attributes = read_records(source, _CLASSES)
    inference = parts.pop("inference", None)
    if inference is None:
        raise StoreError(f"{source} holds no inference; `chemage infer` makes such files")
    try:
        about = json.loads(attributes.get("asked", "{}"))
        labels = about.get("labels", [])
        experiments, target = tuple(about.get("experiments", ())), str(about.get("target", ""))
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise StoreError(f"{source}: what was asked of the inference cannot be read: {error}") from error
    labels += [f"forecast {number}" for number in range(len(labels) + 1, len(parts) + 1)]
    return InferenceResult(inference, dict(zip(labels, parts.values(), strict=False)), experiments, target)
