"""``python -m chemage.cli``."""

from chemage.cli.app import main

main()
