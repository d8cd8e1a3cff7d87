"""`bringup` by the name of the package in which it used to be: it is fin_bringup's."""

from __future__ import annotations

import sys
from importlib import import_module


def main() -> int:
    """Run the command of fin_bringup, which depends on this package and is looked for when it is asked for."""
    return int(import_module("fin_bringup.bringup").main())


if __name__ == "__main__":
    sys.exit(main())
