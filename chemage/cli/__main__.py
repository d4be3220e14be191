"""``python -m chemage.cli``."""

from chemage.cli import main

main()
