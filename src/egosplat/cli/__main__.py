"""``python -m egosplat.cli``."""

from egosplat.cli import main

main()
