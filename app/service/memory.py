"""How the C library hands out memory in a server process: given back soon, rather than kept for each thread."""

import contextlib
import ctypes

import pyarrow as pa

ARENA_MAX = -8  # the number of the setting in glibc's malloc.h
ARENAS = 2  # pools that threads share; glibc's own default is eight for each processor; chosen

# Blocks of this many bytes on have pages of their own, which go back to the system when they are freed. The library
# would raise that to 32 MB after the first of them, and bodies would leave holes between what stays.
MMAP_THRESHOLD, OWN_BLOCK = -3, 1 << 18


def spare_memory() -> None:
    """Let threads share what they free, Arrow's tables too; call it before there are any."""
    with contextlib.suppress(AttributeError):  # no glibc: it keeps nothing for each thread
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(ARENA_MAX, ARENAS)
        mallopt(MMAP_THRESHOLD, OWN_BLOCK)
    pa.set_memory_pool(pa.system_memory_pool())
