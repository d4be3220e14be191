"""Warnings about what is computed, and not about how a plugin behaves."""

from __future__ import annotations


class PlanWarning(UserWarning):
    """What a user should know of a run before it begins, as ``chemage check`` says it."""
