"""Make every check of a release, and say which pass: `make release`.

Each check is a function that returns what it found, or raises `CheckError` with what is to be done. All of them run,
the long ones last, and the command fails where one does. When all pass, the tag `v` with the version is what remains.
"""

import datetime
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import licenses
import links
from licenses import output
from version import NUMBER, versions

ROOT = Path(__file__).parents[1]
PNG = b"\x89PNG\r\n\x1a\n"


class CheckError(Exception):
    """A check does not pass; the text says what is to be done."""


def main() -> None:
    """Run the checks and print a line for each."""
    failures = sum(not passes(check) for check in CHECKS)
    if failures:
        sys.exit(f"\n{failures} of {len(CHECKS)} checks fail: this is not to be released")
    print(f"\nall {len(CHECKS)} checks pass: tag this commit v{version()}, and publish what is in dist")


def passes(check: Callable[[], str]) -> bool:
    """Run one check, print its outcome, and tell whether it passes."""
    name = (check.__doc__ or "").removeprefix("Check that ").rstrip(".")
    try:
        print(f"pass  {name}: {check()}", flush=True)
    except CheckError as reason:
        print(f"FAIL  {name}: {reason}", flush=True)
        return False
    return True


def version() -> str:
    """Return the version that is to be released."""
    return versions()["pyproject.toml"]


def tree_is_clean() -> str:
    """Check that nothing is left to commit."""
    changed = output("git", "status", "--porcelain").splitlines()
    if changed:
        raise CheckError(f"{len(changed)} files are not committed, such as {changed[0].split()[-1]}")
    return f"at {output('git', 'rev-parse', '--short', 'HEAD').strip()}"


def version_is_the_same_everywhere() -> str:
    """Check that the version is the same in every file."""
    found = versions()
    strange = {place: number for place, number in found.items() if number != version()}
    if strange:
        raise CheckError(f"{version()} in pyproject.toml, but {strange}: python .ci/version.py {version()}")
    return f"{version()} in {len(found)} files"


def version_is_new() -> str:
    """Check that the version has no tag yet, and follows the latest one."""
    tags = [tag.removeprefix("v") for tag in output("git", "tag", "--list", "v*").split()]
    released = [tag for tag in tags if re.fullmatch(NUMBER, tag)]
    if version() in released:
        raise CheckError(f"v{version()} is tagged: python .ci/version.py with the next version")
    latest = max(released, key=order, default=None)
    if latest and order(version()) < order(latest):
        raise CheckError(f"{version()} comes before {latest}, which is tagged")
    return f"after {latest}" if latest else "the first one that is tagged"


def order(number: str) -> tuple[int, int, int, tuple[int, str, int]]:
    """Return what sorts versions; 1.2.3rc1 comes before 1.2.3."""
    major, minor, patch, kind, count = re.fullmatch(r"(\d+)\.(\d+)\.(\d+)(?:(a|b|rc)(\d+))?", number).groups()
    return int(major), int(minor), int(patch), (0, kind, int(count)) if kind else (1, "", 0)


def changelog_has_the_version() -> str:
    """Check that the changelog has the version with its date."""
    sections = re.split(r"(?m)^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))[1:]
    unreleased = next((text for text in sections if text.startswith("[Unreleased]")), "")
    if unreleased.partition("\n")[2].strip():
        raise CheckError(
            'the section "Unreleased" is not empty: python .ci/version.py VERSION makes it its own'
        )
    own = next((text for text in sections if text.startswith(f"[{version()}]")), "")
    dated = re.match(r"\[.*\] - (\d{4}-\d{2}-\d{2})\n", own)
    if not dated or not own.partition("\n")[2].strip():
        raise CheckError(f"it must have a section ## [{version()}] - YYYY-MM-DD that says what is new")
    if datetime.date.fromisoformat(dated[1]) > datetime.datetime.now(datetime.UTC).date():
        raise CheckError(f"the date {dated[1]} is in the future")
    return dated[1]


def licences_are_complete() -> str:
    """Check that the licence texts are those of what is compiled into the kernel."""
    wanted = licenses.crates() | {licenses.STANDARD_LIBRARY: licenses.standard_library()}
    held = {path.name: path.read_text(encoding="utf-8") for path in licenses.FOLDER.glob("*.txt")}
    if wanted != held:
        different = sorted(name for name in wanted | held if wanted.get(name) != held.get(name))
        raise CheckError(f"{', '.join(different)}: make licenses")
    return f"{len(held)} files"


def figures_are_present() -> str:
    """Check that every figure of the texts is there and is an image."""
    texts = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    shown = {(text.parent / link).resolve() for text in texts for link in links.images(text)}
    missing = [str(path.relative_to(ROOT)) for path in sorted(shown) if not is_image(path)]
    if missing:
        raise CheckError(f"{', '.join(missing)}: missing, or no image")
    return f"{len(shown)} figures"


def is_image(path: Path) -> bool:
    """Tell whether a file is there and begins as an image of its kind does."""
    if not path.is_file():
        return False
    begin = path.read_bytes()[:1024]
    return begin.startswith(PNG) if path.suffix == ".png" else b"<svg" in begin or begin.startswith(b"GIF8")


def sdist_is_reproducible() -> str:
    """Check that two builds of the sdist are the same bit for bit."""
    moment = output("git", "log", "-1", "--format=%ct").strip()
    settings = {**os.environ, "PRICING_CORE_KERNEL": "none", "SOURCE_DATE_EPOCH": moment}
    build = (sys.executable, "-m", "build", "--no-isolation", "--sdist", "--outdir")
    built = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as folder:
            command("the build", *build, folder, variables=settings)
            (sdist,) = Path(folder).iterdir()
            built.append(sdist.read_bytes())
    if built[0] != built[1]:
        raise CheckError("they differ: see ReproducibleSdist in setup.py")
    return f"{len(built[0]):,} bytes"


def style_and_types() -> str:
    """Check that style, types, import contract and workflows pass."""
    return command("make check", "make", "check")


def documentation_builds() -> str:
    """Check that the documentation builds without a warning, and its links lead somewhere."""
    return command("make docs", "make", "docs")


def wheels_build() -> str:
    """Check that the wheel builds from the sdist, installs, and prices on every Python found."""
    return command("make wheels", "make", "wheels")


def image_builds() -> str:
    """Check that the steps of the image lead to a price over HTTP."""
    return command("make image", "make", "image")


def command(name: str, *words: str, variables: dict[str, str] | None = None) -> str:
    """Run a command; its last lines say why it fails."""
    done = subprocess.run(words, cwd=ROOT, env=variables, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stdout + done.stderr).strip().splitlines()[-8:]
        raise CheckError("\n      ".join([f"{name} fails", *last]))
    return "done"


CHECKS = (
    tree_is_clean,
    version_is_the_same_everywhere,
    version_is_new,
    changelog_has_the_version,
    licences_are_complete,
    figures_are_present,
    sdist_is_reproducible,
    style_and_types,
    documentation_builds,
    wheels_build,
    image_builds,
)

if __name__ == "__main__":
    main()
