"""Means over random surfaces, as accurate as asked or as a time allows, with every part of their errors named."""
