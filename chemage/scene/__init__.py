"""Experiments: scenes, their schema, what they need, what took part in them, and the run of one from end to end."""
