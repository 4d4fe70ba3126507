"""See ``python reproduce.py --help``."""

from geoskill.apps.reproduce import main

if __name__ == "__main__":
    main()
