"""See ``python train.py --help``."""

from geoskill.cli.train import main

if __name__ == "__main__":
    main()
