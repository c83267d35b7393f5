"""`python -m robosim`: the command line."""

import sys

from robosim.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
