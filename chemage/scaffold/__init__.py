"""The scaffold: the folder of a new plugin."""
