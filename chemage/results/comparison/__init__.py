"""Comparison of several results with each other and with measurements."""

from chemage.results.comparison.comparison import TIMES, Comparison, compare_files
from chemage.results.comparison.entries import Entry, load_results
from chemage.results.comparison.figures import comparison_figures

__all__ = ["TIMES", "Comparison", "Entry", "compare_files", "comparison_figures", "load_results"]
