"""Interactions, by which a bond changes the barriers of neighbouring sites: ``elastic-pairs``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chemage.plugin import hookimpl, lazy_attributes

if TYPE_CHECKING:
    from chemage_interactions.elastic_pairs import ElasticPairs as ElasticPairs

KINDS = {"interaction": {"elastic-pairs": "chemage_interactions.elastic_pairs:ElasticPairs"}}

__getattr__ = lazy_attributes(KINDS)


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The interactions of this package."""
    return KINDS
