"""Collect the licence texts of what is compiled into the kernel, in `licenses/`: `make licenses`.

Each crate of `kernels/Cargo.lock` has a file with the texts that it is published with, and the standard library of Rust
has one with the notices that come with the toolchain. Where a crate may be had under the MIT licence or the Apache
licence, the MIT licence is the one taken. The wheel carries the files in `dist-info/licenses`.
"""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "licenses"
OURS = "pricing-kernels"
STANDARD_LIBRARY = "rust-standard-library.txt"
TEXTS = re.compile(r"(?i)(licen[cs]e|copying|copyright|notice|unlicense)")
RULE = "\n" + "-" * 80 + "\n"


def main() -> None:
    """Write all texts anew."""
    for path in FOLDER.glob("*.txt"):
        path.unlink()
    for name, text in crates().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    (FOLDER / STANDARD_LIBRARY).write_text(standard_library(), encoding="utf-8")
    print(f"{len(list(FOLDER.glob('*.txt')))} texts in {FOLDER}")


def crates() -> dict[str, str]:
    """Return the texts of every crate that the kernel depends on, on any platform, by the name of its file."""
    manifest = f"--manifest-path={ROOT / 'kernels' / 'Cargo.toml'}"
    told = output("cargo", "metadata", "--locked", "--format-version=1", manifest, "--all-features")
    found = {}
    for package in json.loads(told)["packages"]:
        if package["name"] != OURS:
            source, expression = Path(package["manifest_path"]).parent, package["license"]
            files = [path for path in sorted(source.iterdir()) if path.is_file() and TEXTS.match(path.name)]
            texts = [file.read_text(encoding="utf-8") for file in taken(files, expression)]
            if not texts:
                sys.exit(f"{package['name']} {package['version']} comes without a licence text")
            head = f"{package['name']} {package['version']}\nLicence: {expression}\n"
            found[f"{package['name']}-{package['version']}.txt"] = RULE.join([head, *map(clean, texts)])
    return found


def taken(files: list[Path], expression: str) -> list[Path]:
    """Return the texts less that of the Apache licence where the MIT licence may be chosen in its place."""
    choice = re.search(r"\bOR\b|/", expression) and any("MIT" in file.name for file in files)
    return [file for file in files if not (choice and "APACHE" in file.name.upper())]


class Notices(HTMLParser):
    """Reads the text of the toolchain's notices: paragraphs, headings, and the licence texts in `pre`."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self.dropped = False
        self.skipping = 0

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Begin a heading on a line of its own, and leave out the head and the table of contents."""
        if tag in ("title", "ul"):
            self.skipping += 1
        elif tag in ("h1", "h2", "h3"):
            self.parts.append(RULE)

    def handle_endtag(self, tag: str) -> None:
        """End what a start tag has begun."""
        if tag in ("title", "ul"):
            self.skipping -= 1

    def handle_data(self, data: str) -> None:
        """Keep a text, less the copies of the Apache licence beside the MIT licence."""
        if self.skipping:
            return
        if self.lasttag == "code" and re.match(r"(?i)(licen|copy|auth)", data):
            self.dropped = "apache" in data.lower()
        if not (self.lasttag == "pre" and self.dropped):
            self.parts.append(data)


def standard_library() -> str:
    """Return the notices of the standard library of the toolchain at hand."""
    documents = Path(output("rustc", "--print", "sysroot").strip()) / "share/doc/rust"
    notices = Notices()
    notices.feed((documents / "COPYRIGHT-library.html").read_text(encoding="utf-8"))
    lines = [line for line in "".join(notices.parts).splitlines() if not line.strip().startswith("URL:")]
    version = output("rustc", "--version").split()[1]
    texts = [
        (documents / f"licenses/{name}.txt").read_text(encoding="utf-8") for name in ("MIT", "Unicode-3.0")
    ]
    head = f"The standard library of Rust {version}\nLicence: MIT OR Apache-2.0, its tables of characters Unicode-3.0\n"
    return RULE.join([head, *map(clean, texts)]) + clean("\n".join(lines))


def clean(text: str) -> str:
    """Return a text with plain line ends, without spaces at them, and with at most one empty line in a row."""
    lines = "\n".join(line.rstrip() for line in text.splitlines())
    return re.sub(r"\n{3,}", "\n\n", lines).strip("\n") + "\n"


def output(*command: str) -> str:
    """Return what a command prints, run at the root of the project."""
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    main()
