"""Entry point of ``python -m colift``."""

from colift.cli.app import main

if __name__ == "__main__":
    main()
