"""The optional dependencies by the name of their extra, and the error of an import that lacks one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pricing_core.errors import MissingExtraError

# The modules that each extra installs, as `pyproject.toml` has them.
EXTRAS = {
    "batch": ("fsspec", "pyarrow"),
    "client": ("httpx", "pyarrow"),
    "cluster": ("dask", "distributed"),
    "cli": ("rich", "typer"),
    "plot": ("jinja2", "matplotlib", "PIL"),
    "service": (
        "fastapi",
        "httptools",
        "prometheus_client",
        "pyarrow",
        "pydantic",
        "pydantic_settings",
        "starlette",
        "uvicorn",
    ),
}


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Import modules of an extra inside the block.

    Raises
    ------
    MissingExtraError
        One of them is not installed; the message says what to install.

    Examples
    --------
    >>> with needs_extra("batch"):
    ...     raise ModuleNotFoundError("No module named 'pyarrow'", name="pyarrow")
    Traceback (most recent call last):
    ...
    pricing_core.errors.MissingExtraError: pyarrow is not installed: pip install "pricing-core[batch]"
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise explained(error, extra) from None


def explained(error: ModuleNotFoundError, extra: str) -> ImportError:
    """Return the error that names the extra of the missing module; the error itself where it is none of the extra's."""
    missing = (error.name or "").partition(".")[0]
    if missing not in EXTRAS[extra]:
        return error
    return MissingExtraError(f'{missing} is not installed: pip install "pricing-core[{extra}]"')
