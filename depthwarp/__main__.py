"""`python -m depthwarp` is the program `depthwarp`."""

from __future__ import annotations

__all__ = ["main"]

INTERRUPTED = 130


def main() -> None:
    """Run the program; Ctrl-C while it is being loaded ends it without a traceback."""
    try:
        from depthwarp.cli.main import main as run
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    run()


if __name__ == "__main__":
    main()
