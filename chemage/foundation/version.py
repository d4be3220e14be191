"""The version of chemage."""

__version__ = "0.1.0"
