"""``python -m fieldlink.cli``."""

from fieldlink.cli import main

main()
