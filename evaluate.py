"""See ``python evaluate.py --help``."""

from geoskill.cli.evaluate import main

if __name__ == "__main__":
    main()
