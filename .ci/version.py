"""The version, in every file that states it: `python .ci/version.py` compares them, `... 1.2.3` writes a new one.

`pyproject.toml` is the one that counts; the code, the documentation and the service read it from the installed package.
A new version also ends the section "Unreleased" of the changelog, which becomes that of the version, with today's date.
"""

import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
NUMBER = r"\d+\.\d+\.\d+(?:(?:a|b|rc)\d+)?"
# What stands before the version in each file.
PLACES = {
    "pyproject.toml": r'(?m)^version = "',
    "kernels/Cargo.toml": r'(?m)^version = "',
    "kernels/Cargo.lock": r'name = "pricing-kernels"\nversion = "',
    "CITATION.cff": r"(?m)^version: ",
    "deploy/compose.yaml": r"image: pricing-core:",
    "deploy/kubernetes/deployment.yaml": r"image: pricing-core:",
}
UNRELEASED = "## [Unreleased]\n"


def versions(root: Path = ROOT) -> dict[str, str]:
    """Return the version that each file states."""
    return {name: stated(root / name, before)[1] for name, before in PLACES.items()}


def stated(path: Path, before: str) -> re.Match[str]:
    """Return where a file states the version, as the first group; it must do so once."""
    found = list(re.finditer(f"{before}({NUMBER})(?![.\\w])", path.read_text(encoding="utf-8")))
    if len(found) != 1:
        sys.exit(f"{path} states a version {len(found)} times, not once")
    return found[0]


def write(version: str, root: Path = ROOT) -> None:
    """Write a new version into every file, and its heading into the changelog."""
    if not re.fullmatch(NUMBER, version):
        sys.exit(f"{version!r} is no version: it must be three numbers, such as 1.2.3, or such as 1.2.3rc1")
    for name, before in PLACES.items():
        path = root / name
        text, (start, end) = path.read_text(encoding="utf-8"), stated(path, before).span(1)
        path.write_text(text[:start] + version + text[end:], encoding="utf-8")
    changelog = root / "CHANGELOG.md"
    text = changelog.read_text(encoding="utf-8")
    if UNRELEASED not in text:
        sys.exit(f"{changelog} has no section {UNRELEASED.strip()}")
    today = datetime.datetime.now(datetime.UTC).date()
    heading = f"{UNRELEASED}\n## [{version}] - {today}\n"
    changelog.write_text(text.replace(UNRELEASED, heading, 1), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        write(sys.argv[1])
    for place, number in versions().items():
        print(f"{number:12}{place}")
    sys.exit(len(set(versions().values())) != 1)
