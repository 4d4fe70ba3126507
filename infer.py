"""See ``python infer.py --help``."""

from geoskill.apps.infer import main

if __name__ == "__main__":
    main()
