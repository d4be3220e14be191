"""The sections [[step]], [protocol] and [drive] of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from chemage.plugin import Stage

#: what these sections need
_NEEDS: dict[str, Any] = {"needs": "forming", "only_with": "hold", "key": "ageing"}


class _Steps(Stage):
    def fills(self, data: Mapping[str, Any]) -> Mapping[str, dict[str, Any]]:
        return {"protocol": {"kind": "steps", "step": data[self.section]}}


class _Protocol(Stage):
    def method(self, parts: Mapping[str, Any]) -> Any:
        from chemage_history.programme import Programme

        return Programme(protocol=parts[self.section], drive=parts.get("drive"))

    def fills(self, data: Mapping[str, Any]) -> Mapping[str, dict[str, Any]]:
        from chemage import ChemageError

        try:
            times = self.method(data).times().tolist()
        except ChemageError:  # reported where the section is read
            times = [0.0]
        return {"hold": {"times": times}}

    def problems(self, parts: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
        from chemage import ChemageError

        if self.section not in parts:
            return
        if "ageing" in parts:
            yield "ageing", "the steps follow every site; leave this out"
        try:
            self.method(parts).check_sections(parts)
        except ChemageError as error:
            yield self.section, str(error)

    def doubts(
        self, parts: Mapping[str, Any], stated: Mapping[str, Any]
    ) -> Iterator[Any]:
        if self.section in parts:
            yield from self.method(parts).doubts(parts, stated)


STAGES = (
    _Steps(
        "step", many=True, options="chemage_history.steps:HistoryStep", **_NEEDS
    ),
    Stage("drive", options="chemage_history.steps:Slider", **_NEEDS),
    _Protocol("protocol", role="protocol", **_NEEDS),
)
