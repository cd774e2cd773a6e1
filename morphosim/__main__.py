"""The command line, as `python -m morphosim`."""

from morphosim.cli import main

if __name__ == "__main__":
    main()
