"""Suggestions for misspelled names."""

from __future__ import annotations

from chemage.plugin import nearest


def test_nearest():
    assert nearest("hertzz", ["hertz", "fft-bem"]) == " (did you mean 'hertz'?)"
    assert nearest("qqq", ["hertz", "fft-bem"]) == ""
    assert nearest("x", []) == ""
