"""Comparison of several results with each other and with measurements."""

from chemage.reports.comparison.comparison import TIMES, Comparison, compare_files
from chemage.reports.comparison.entries import Entry, load_results
from chemage.reports.comparison.figures import comparison_figures

__all__ = ["TIMES", "Comparison", "Entry", "compare_files", "comparison_figures", "load_results"]
