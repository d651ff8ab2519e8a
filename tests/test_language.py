"""What a script can see of the language of the code: comments, docstrings, words that have a plainer one."""

import ast
import importlib
import inspect
import io
import re
import tokenize
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODE = [
    path
    for folder in ("pricing_core", "app", "benchmarks", "examples")
    for path in (ROOT / folder).rglob("*.py")
]
RUST = sorted((ROOT / "kernels/src").rglob("*.rs"))
# Private metaphors, each with the word that is meant.
INSTEAD = {
    "rung": "degree",
    "outset": "onset of contact",
    "stretch of time": "segment",
    "sight": "evaluation at the spot",
}
METAPHOR = re.compile(r"\b(" + "|".join(INSTEAD) + r")s?\b", re.IGNORECASE)
# Endings of a summary: a sentence or question, or the colon before a list or a formula.
ENDINGS = (".", "?", "!", ":", "::")


def docstrings(path: Path) -> Iterator[tuple[str, ast.AST, str]]:
    """Yield name, node and docstring of the module, its classes and its functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "name", path.stem), node, text


def place(path: Path, line: int | str) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


def test_no_comment_begins_with_of():
    found = [
        place(path, token.start[0])
        for path in CODE
        for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
        if token.type == tokenize.COMMENT and re.match(r"#+\s*Of\b", token.string)
    ]
    found += [
        place(path, number)
        for path in RUST
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.match(r"\s*//[/!]?\s*Of\b", line)
    ]
    assert not found


def test_no_private_metaphors():
    found = [
        f"{place(path, number)}: {match[0]}, say {INSTEAD[match[1].lower()]}"
        for path in (*CODE, *RUST, *(ROOT / "docs").glob("*.md"), ROOT / "README.md")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for match in METAPHOR.finditer(line)
    ]
    assert not found


def test_docstrings_are_sentences():
    found = []
    for path in CODE:
        for name, node, text in docstrings(path):
            summary = text.split("\n\n")[0]
            # A formula may come first.
            starts = (
                re.match(r"[A-Z0-9`\"'{(/$-]", summary)
                or "=" in summary.split(".")[0]
                or summary.startswith(name)
            )
            if not starts or not summary.rstrip().endswith(ENDINGS):
                found.append(f"{place(path, getattr(node, 'lineno', 1))}: {summary[:70]}")
    assert not found


# The packages whose names the reference of the documentation lists.
PUBLIC = re.findall(
    r"automodule:: (\S+)",
    "".join(path.read_text() for path in sorted((ROOT / "docs/reference").glob("*.md"))),
)


def named_in(text: str, name: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text) is not None


def parameters(called: Callable[..., object]) -> list[str]:
    try:
        names = inspect.signature(called).parameters
    except ValueError:  # A built-in class, such as that of texts, tells none.
        return []
    return [name for name in names if name not in ("self", "cls") and not name.startswith("_")]


def methods(kind: type) -> Iterator[tuple[str, Callable[..., object]]]:
    """Yield the public methods of a class, those that it has inherited from classes of ours included."""
    for name, member in inspect.getmembers(kind):
        function = getattr(member, "__func__", member)
        public = not name.startswith("_") and inspect.isfunction(function)
        if public and function.__module__.startswith(("app", "pricing_core")):
            yield name, function


@pytest.mark.parametrize("package", PUBLIC)
def test_every_parameter_is_named_where_it_is_documented(package):
    """A parameter of a function is in its docstring, one of a method in its own or that of its class."""
    module = importlib.import_module(package)
    missing = []
    own_names = [name for name, value in vars(module).items() if getattr(value, "__module__", "") == package]
    for name in getattr(module, "__all__", own_names):
        public = getattr(module, name)
        if inspect.isfunction(public):
            missing += [
                f"{name}: {one}" for one in parameters(public) if not named_in(public.__doc__ or "", one)
            ]
        elif inspect.isclass(public):
            own = "\n".join(base.__doc__ or "" for base in public.__mro__ if base is not object)
            built = [] if getattr(public, "_is_protocol", False) else parameters(public)
            missing += [f"{name}: {one}" for one in built if not named_in(own, one)]
            for method, function in methods(public):
                text = f"{own}\n{function.__doc__}"
                missing += [
                    f"{name}.{method}: {one}" for one in parameters(function) if not named_in(text, one)
                ]
    assert not missing
