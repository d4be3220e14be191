"""Creates the folder of a new plugin."""
