"""Plugins: the markers of hooks, the registry that finds plugins, and the record of who took part in a result."""
