"""Entry point of `python -m drivecomm`: the command line."""

from drivecomm.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
