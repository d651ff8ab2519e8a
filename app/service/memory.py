"""How the C library hands out memory in a server process: given back soon, rather than kept for each thread."""

import contextlib
import ctypes

import pyarrow as pa

ARENA_MAX = -8  # the number of the setting in glibc's malloc.h
ARENAS = 2  # pools that threads share; glibc's own default is eight for each processor; chosen


def spare_memory() -> None:
    """Let threads share what they free, Arrow's tables too; call it before there are any."""
    with contextlib.suppress(AttributeError):  # no glibc: it keeps nothing for each thread
        ctypes.CDLL(None).mallopt(ARENA_MAX, ARENAS)
    pa.set_memory_pool(pa.system_memory_pool())
