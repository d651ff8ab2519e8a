"""The `pricing` command; `python -m app` is the same."""

import sys


def main() -> None:
    """Run the command line, or say in one line what it lacks."""
    try:
        from app.cli import main as run  # noqa: PLC0415
    except ModuleNotFoundError as error:
        from pricing_core.extras import explained  # noqa: PLC0415

        print(f"pricing: {explained(error, 'cli')}", file=sys.stderr)
        sys.exit(2)
    run()


if __name__ == "__main__":
    main()
