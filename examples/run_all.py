"""Run every numbered example, two at a time: `make examples`.

What each prints is written beside its picture, as examples/out/NN_name.txt, from where the documentation takes both.
The status is 1 where an example fails, which its assertions decide. Without the compiled kernel, where some would take
an hour, none is run.
"""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pricing_core import kernel_name

HERE = Path(__file__).parent
OUT = HERE / "out"
AT_ONCE = 2
SECONDS = 120.0  # that one may take


def run(script: Path) -> tuple[Path, float, str]:
    """Run one example; return how long it took, and what went wrong, which is empty where nothing did."""
    start = time.perf_counter()
    environment = os.environ | {"MPLBACKEND": "agg", "OMP_NUM_THREADS": "1"}
    try:
        ran = subprocess.run(
            [sys.executable, str(script.relative_to(HERE.parent))],
            cwd=HERE.parent,
            env=environment,
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return script, SECONDS, f"not ended after {SECONDS:g} s"
    (OUT / f"{script.stem}.txt").write_text(ran.stdout, encoding="utf-8")
    return script, time.perf_counter() - start, ran.stderr if ran.returncode else ""


def main() -> int:
    """Run all of them, and print how long each took."""
    if kernel_name() != "rust":
        print("the examples need the compiled kernel, which needs Rust 1.89 or later", file=sys.stderr)
        return 2
    OUT.mkdir(exist_ok=True)
    scripts = sorted(HERE.glob("[0-9][0-9]_*.py"))
    failed = 0
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for script, seconds, wrong in pool.map(run, scripts):
            print(f"{script.stem:32} {seconds:5.1f} s{'   FAILED' if wrong else ''}", flush=True)
            if wrong:
                failed += 1
                print(wrong, file=sys.stderr, flush=True)
    print(f"{len(scripts) - failed} of {len(scripts)} examples hold what they assert")
    return 1 if failed or not scripts else 0


if __name__ == "__main__":
    sys.exit(main())
