"""``python -m chemage``."""

from chemage.cli import main

main()
