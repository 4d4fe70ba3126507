"""See ``python infer.py --help``."""

from geoskill.cli.infer import main

if __name__ == "__main__":
    main()
