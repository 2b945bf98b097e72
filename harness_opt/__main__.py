"""``python -m harness_opt``, the same as ``harness-opt``."""

import sys

from harness_opt.cli import main

if __name__ == "__main__":
    sys.exit(main())
