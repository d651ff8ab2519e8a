"""Compile the kernel where Rust is new enough; without it the package is pure Python, and prices in NumPy.

The sdist is the same bit for bit whenever and wherever it is built from the same files: its entries are in order, have
no owner, and carry the time of SOURCE_DATE_EPOCH: where that is not set 1980-01-01, the oldest time in a wheel.
"""

import gzip
import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

from setuptools import setup
from setuptools.command.sdist import sdist
from setuptools_rust import Binding, RustExtension

if sys.version_info < (3, 11):  # noqa: UP036 - pip reads the requirement only after this has run
    sys.exit(f"pricing-core needs Python 3.11 or later; this is Python {sys.version.split()[0]}")

MANIFEST = Path(__file__).parent / "kernels" / "Cargo.toml"
# The oldest Python whose stable interface the kernel is compiled for, as in `requires-python` and pyo3's feature.
OLDEST_PYTHON = "cp311"
OLDEST_TIME = 315532800  # 1980-01-01 in seconds since 1970


class ReproducibleSdist(sdist):
    """The sdist, packed so that equal files make equal archives."""

    def make_archive(self, base_name, format, root_dir=None, base_dir=None, owner=None, group=None):  # noqa: A002
        """Pack the folder `base_dir` and return the name of the archive."""
        if format != "gztar":
            return super().make_archive(base_name, format, root_dir, base_dir, owner, group)
        moment = int(os.environ.get("SOURCE_DATE_EPOCH", OLDEST_TIME))

        def plain(entry):
            executable = entry.isdir() or entry.mode & 0o100
            entry.mode, entry.mtime = 0o755 if executable else 0o644, moment
            entry.uid = entry.gid = 0
            entry.uname = entry.gname = ""
            return entry

        folder = Path(root_dir or ".")
        target = Path(f"{base_name}.tar.gz")
        with (
            target.open("wb") as file,
            gzip.GzipFile("", "wb", 9, file, moment) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for path in sorted((folder / base_dir).rglob("*")):
                if path.name == "setup.cfg" or "egg-info" in path.as_posix():
                    continue  # written by setuptools on the way; PKG-INFO says all of it
                archive.add(path, path.relative_to(folder).as_posix(), recursive=False, filter=plain)
        return str(target)


def why_no_kernel() -> str:
    """Return why the kernel is left out; nothing where it is to be compiled."""
    import tomllib  # noqa: PLC0415

    wanted = os.environ.get("PRICING_CORE_KERNEL", "auto")
    if wanted not in ("auto", "none"):
        sys.exit(f'PRICING_CORE_KERNEL = {wanted!r}: must be "auto" or "none"')
    if wanted == "none":
        return "PRICING_CORE_KERNEL is none"
    if shutil.which(os.environ.get("CARGO", "cargo")) is None:
        return "cargo is not on PATH"
    compiler = os.environ.get("RUSTC", "rustc")
    try:
        told = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        return f"{compiler} does not run: {error}"
    found = re.search(r"(\d+)\.(\d+)", told)
    oldest = tomllib.loads(MANIFEST.read_text())["package"]["rust-version"]
    if found is None or tuple(map(int, found.groups())) < tuple(map(int, oldest.split("."))):
        return f"{told.strip()} is older than {oldest}"
    return ""


reason = why_no_kernel()
if reason:
    print(f"pricing-core: the kernel is not compiled, since {reason}", file=sys.stderr)
    setup(cmdclass={"sdist": ReproducibleSdist})
else:
    kernel = RustExtension(
        "pricing_core._kernels",
        path=str(MANIFEST.relative_to(Path(__file__).parent)),
        binding=Binding.PyO3,
        features=["python"],
        args=["--locked"],
        debug=False,
    )
    try:
        setup(
            cmdclass={"sdist": ReproducibleSdist},
            rust_extensions=[kernel],
            options={"bdist_wheel": {"py_limited_api": OLDEST_PYTHON}},
        )
    except SystemExit as end:
        if "cargo" not in str(end.code):
            raise
        sys.exit(
            f"{end.code}\npricing-core: the kernel was not compiled; PRICING_CORE_KERNEL=none installs without it"
        )
