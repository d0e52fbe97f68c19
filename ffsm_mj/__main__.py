"""``python -P -m ffsm_mj`` is the command line; without ``-P``, Python imports from the current folder first."""

from __future__ import annotations

import sys

from ffsm_mj.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
