"""`python -m lostlink`."""

from lostlink.cli.entry import main

if __name__ == "__main__":
    main()
