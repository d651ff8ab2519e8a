"""The `pricing` command; `python -m app` is the same."""

import sys

from app.start_up import end_by_signals, leave_signals, open_closed_streams


def main() -> None:
    """Run the command line, or say in one line what it lacks."""
    open_closed_streams()
    end_by_signals()
    try:
        from app.cli import main as run  # noqa: PLC0415
    except ModuleNotFoundError as error:
        from pricing_core.extras import explained  # noqa: PLC0415

        print(f"pricing: {explained(error, 'cli')}", file=sys.stderr)
        sys.exit(2)
    try:
        run()
    finally:
        leave_signals()


if __name__ == "__main__":
    main()
