"""`python -m lostlink`: as the command, it imports no agents from the working directory."""

import sys
from pathlib import Path

if __name__ == "__main__":
    if not sys.flags.safe_path and sys.path[0] != str(Path(__file__).parents[1]):  # else it is ours
        del sys.path[0]
    from lostlink.cli.entry import main

    main()
