"""The map of the folders in CONTRIBUTING.md, held against the tree."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Folders that are written by tools, and those that the map leaves to another text: benchmarks/README.md, and the code.
WRITTEN = {"build", "dist", "out", "jupyter_execute", "site", "target", "__pycache__"}
TOLD_ELSEWHERE = {"benchmarks", "tests"}
SOURCES = {".py", ".rs", ".js", ".md", ".json", ".toml", ".csv", ".yaml", ".yml"}


def folders(folder: Path) -> set[str]:
    """Return the folders that hold sources, relative to the root."""
    found = set()
    for path in folder.iterdir():
        if not path.is_dir() or path.name in WRITTEN or path.name.endswith(".egg-info"):
            continue
        if path.name.startswith(".") and path.name not in (".ci", ".github"):
            continue
        name = path.relative_to(ROOT).as_posix()
        if any(file.suffix in SOURCES for file in path.iterdir() if file.is_file()):
            found.add(name)
        if name not in TOLD_ELSEWHERE:
            found |= folders(path)
    return found


def test_every_folder_has_one_line_in_the_map():
    mapped = re.findall(r"^\| `([^`]+)/` \| \S", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE)
    assert len(mapped) == len(set(mapped))
    engines = {name for name in mapped if "/" not in name and not (ROOT / name).is_dir()}  # of another table
    assert set(mapped) - engines == folders(ROOT)
