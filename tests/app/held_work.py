"""`pricing` as it is, but for work that a test holds: once begun it ends when the test says so, or when it is told to.

A price, or a row of JSON of a batch, is held where its strike is `HELD_STRIKE`, and so is a unit of `pricing batch`
from the one on that the test names. Run as `python -m tests.app.held_work`, with the arguments of `pricing`.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self
from uuid import uuid4

HELD_STRIKE = 99.0
FOLDER, FIRST_UNIT, LAST_SECONDS = "HELD_WORK_FOLDER", "HELD_WORK_FIRST_UNIT", "HELD_WORK_LAST_SECONDS"


class HeldWork:
    """Work of other processes, which say in a folder that it has begun, and find there that it is released.

    As a context it is released at the end.

    Parameters
    ----------
    first_unit : int, optional
        The first unit of a batch of the command that is held; none is unless given.
    last_seconds : float, optional
        How long a server that closes waits for the first request of those who have just connected.
    """

    def __init__(
        self, folder: Path, first_unit: int | None = None, last_seconds: float | None = None
    ) -> None:
        folder.mkdir(exist_ok=True)
        self._folder, self._released = folder, folder / "released"
        given = {FOLDER: folder, FIRST_UNIT: first_unit, LAST_SECONDS: last_seconds}
        self.environment = {name: str(value) for name, value in given.items() if value is not None}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    @contextmanager
    def started(self, *arguments: object) -> Iterator[subprocess.Popen[str]]:
        """Start a process of `pricing` with these arguments, which is killed at the end where it has not ended."""
        with subprocess.Popen(
            [sys.executable, "-m", "tests.app.held_work", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | self.environment,
        ) as process:
            try:
                yield process
            finally:
                process.kill()

    @property
    def begun(self) -> int:
        """How many pieces of work have begun."""
        return len(list(self._folder.glob("begun-*")))

    def release(self) -> None:
        """Let go what is held, and hold nothing more."""
        self._released.touch()

    def hold(self, interrupt: Callable[[], bool] = lambda: False) -> None:
        """Say that a piece of work has begun, and wait until it may go on."""
        (self._folder / f"begun-{uuid4().hex}").touch()
        while not (interrupt() or self._released.exists()):
            time.sleep(0.005)


def hold_in_this_process(held: HeldWork) -> None:
    """Put the waiting before the work itself, where it runs; all else stays as it is."""
    from app.service import server  # noqa: PLC0415
    from app.service.batch import json_rows  # noqa: PLC0415
    from app.service.routes import price as route  # noqa: PLC0415
    from pricing_core.batch import local_threads  # noqa: PLC0415

    price, price_rows, price_unit = route.price, json_rows.price_rows, local_threads.price_unit

    def held_price(option: Any, market: Any, *, interrupt: Any, **choices: Any) -> Any:
        if option.strike == HELD_STRIKE:
            held.hold(interrupt)
        return price(option, market, interrupt=interrupt, **choices)

    def held_rows(rows: Any, names: Any, settings: Any, interrupt: Any) -> Any:
        if any(isinstance(row, dict) and row.get("strike") == HELD_STRIKE for row in rows):
            held.hold(interrupt)
        return price_rows(rows, names, settings, interrupt)

    def held_unit(unit: Any, *arguments: Any, **choices: Any) -> Any:
        if unit.index >= float(os.environ.get(FIRST_UNIT, "inf")):
            held.hold()
        return price_unit(unit, *arguments, **choices)

    route.price, local_threads.price_unit = held_price, held_unit  # type: ignore[assignment]
    json_rows.price_rows = held_rows
    server.LAST_SECONDS = float(os.environ.get(LAST_SECONDS, server.LAST_SECONDS))


def prepare() -> None:
    """Hold the work of this process as its environment says."""
    # As in a terminal, also where the tests run in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    hold_in_this_process(HeldWork(Path(os.environ[FOLDER])))


if __name__ == "__main__":
    from app.__main__ import main

    prepare()
    main()
