"""What a scene says beside the stages of other rooms, and the scenes and materials that a plugin ships."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from chemage.foundation.aliases import Fields
from chemage.plugins.hooks import Doubt, Parts, Stage, Stated, hookspec


@hookspec
def chemage_scenes() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Ship scenes: ``{name: "package:file.toml"}``."""


@hookspec
def chemage_materials() -> Mapping[str, str]:  # pyright: ignore[reportReturnType]
    """Ship materials: ``{name: "package:file.toml"}``; their values fill what a scene does not say."""


class _Fit(Stage):
    def doubts(self, parts: Parts, stated: Stated) -> Iterator[Doubt]:
        from chemage.ageing.fitting import few_hold_times, why_not_fitted
        from chemage.ageing.hooks import method_of
        from chemage.foundation.checks import within

        method = method_of(parts)
        if self.section not in parts or (method is not None and method.unfitted):
            return
        window = (parts[self.section].start, parts[self.section].stop)
        times = parts["hold"].hold_times
        used = times[within(times, window) & (times > 0)]
        if reason := why_not_fitted(times, window):
            yield Doubt("fit", f"beta will not be fitted: {reason}")
        elif doubt := few_hold_times(used.size, (used.min(), used.max())):
            yield Doubt("fit", doubt)


class _Accuracy(Stage):
    def make(self, options: Fields) -> Any:
        from chemage.scene.scene import accuracies

        return accuracies(options)

    def schema(self) -> Fields:
        numbers = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}
        return {
            "type": "object",
            "description": "quantity (beta, friction_drop, friction_coefficient_drop, a measure of the contact; "
            'name@time at a hold time) -> half the width of its 95 % interval over the mean: 0.02, or "2 %"',
            "additionalProperties": {"anyOf": [numbers, {"type": "string"}]},
        }


STAGES = (
    Stage(
        "hold",
        options="chemage.scene.scene:Hold",
        required_with=("forming", "is required where bonds form"),
        needs="forming",
        inputs=("engine",),
        key="ageing",
        always_in_key=True,
    ),
    _Fit(
        "fit",
        options="chemage.scene.scene:FitWindow",
        only_with="hold",
        key="result",
        always_in_key=True,
    ),
    Stage("ensemble", options="chemage.scene.scene:EnsembleOptions"),
    _Accuracy("accuracy"),
)
