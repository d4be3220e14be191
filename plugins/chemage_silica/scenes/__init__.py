"""Scenes that come with chemage, by name."""
