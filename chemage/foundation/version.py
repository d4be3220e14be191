"""The version of chemage."""

__version__ = "0.2.0"
