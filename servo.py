"""See ``python servo.py --help``."""

from geoskill.cli.servo import main

if __name__ == "__main__":
    main()
