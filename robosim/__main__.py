"""`python -m robosim`: the command line."""

import signal
import sys

if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until `main` handles it: an import cut off would print a traceback

from robosim.commands.main import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
