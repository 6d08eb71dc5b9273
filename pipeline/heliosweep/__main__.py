"""``python -m heliosweep``."""

import sys

from heliosweep.cli import main

if __name__ == "__main__":
    sys.exit(main())
