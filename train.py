"""See ``python train.py --help``."""

from geoskill.apps.train import main

if __name__ == "__main__":
    main()
