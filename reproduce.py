"""See ``python reproduce.py --help``."""

from geoskill.cli.reproduce import main

if __name__ == "__main__":
    main()
