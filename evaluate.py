"""See ``python evaluate.py --help``."""

from geoskill.apps.evaluate import main

if __name__ == "__main__":
    main()
