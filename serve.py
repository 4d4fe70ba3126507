"""See ``python serve.py --help``."""

from geoskill.cli.serve import main

if __name__ == "__main__":
    main()
