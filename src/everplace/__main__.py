"""The command's first step, which loads the rest: Ctrl-C is answered from here on."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Runs `everplace`."""
    try:
        from everplace.cli.main import main as run
    except KeyboardInterrupt:
        print("everplace: stopped", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
