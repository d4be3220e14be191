"""Interactions, by which a bond changes the barriers of neighbouring sites: ``elastic-pairs``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from chemage.plugin import hookimpl

if TYPE_CHECKING:
    from chemage_interactions.elastic_pairs import ElasticPairs as ElasticPairs

__all__ = ["ElasticPairs"]


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The interactions of this package."""
    return {"interaction": {"elastic-pairs": "chemage_interactions.elastic_pairs:ElasticPairs"}}


def __getattr__(name: str) -> Any:
    if name == "ElasticPairs":
        from chemage_interactions.elastic_pairs import ElasticPairs

        return ElasticPairs
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
