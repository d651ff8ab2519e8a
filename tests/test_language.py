"""What a script can see of the language of the code: comments, docstrings, words that have a plainer one."""

import ast
import importlib
import inspect
import io
import re
import tokenize
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODE = [
    path
    for folder in ("pricing_core", "app", "benchmarks", "examples")
    for path in (ROOT / folder).rglob("*.py")
]
RUST = sorted((ROOT / "kernels/src").rglob("*.rs"))
FOLDERS = (
    "app",
    "benchmarks",
    "deploy",
    "docs",
    "examples",
    "kernels/src",
    "kernels/tests",
    "pricing_core",
    "tests",
)
SUFFIXES = (".py", ".pyi", ".rs", ".md", ".toml", ".cff", ".js", ".html", ".css", ".yaml", ".yml")
TEXTS = [
    path
    for pattern in ("*", ".ci/*", ".github/**/*", *(f"{folder}/**/*" for folder in FOLDERS))
    for path in sorted(ROOT.glob(pattern))
    if path.suffix in SUFFIXES or path.name in ("Makefile", "Dockerfile", "run")
    if not path.is_relative_to(ROOT / "tests/data") and ".min." not in path.name and path != Path(__file__)
]
# Private metaphors, each with the word that is meant; parts of names in code count as words.
INSTEAD = {
    "rungs?": "degree",
    "outsets?": "onset of contact",
    "stretch(?:es)? of (?:time|the life|the schedule)": "segment",
    "sights?": "evaluation at the spot",
    "judg(?:e[sd]?|ing|e?ments?)": "error estimate, decide or measure",
    "weigh(?:s|ed|ing)?": "quadrature weights, or to have a weight",
    "(?:hears?|heard) (?:of|from)|unheard": "a path leads there",
    "the house": "who is meant",
    "what of it": "what is meant",
}
METAPHORS = {word: re.compile(rf"(?<![a-z]){word}(?![a-z])", re.IGNORECASE) for word in INSTEAD}
# Words that are plain in some folders: the comparison of frozen answers comes to verdicts.
PLAIN = {"judg(?:e[sd]?|ing|e?ments?)": ("benchmarks/frozen_answers/",)}
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


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def matches(pattern: re.Pattern[str], paths: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Yield file, line and text of every match of a pattern."""
    for path in paths:
        for match in pattern.finditer(text_of(path)):
            yield place(path, text_of(path).count("\n", 0, match.start()) + 1), match[0]


def test_the_texts_are_those_of_the_project():
    names = {path.relative_to(ROOT).as_posix() for path in TEXTS}
    assert {
        "README.md",
        "CHANGELOG.md",
        "docs/index.md",
        "examples/demo.py",
        ".ci/run",
        "kernels/src/lib.rs",
    } <= names


@pytest.mark.parametrize("word", INSTEAD)
def test_no_private_metaphors(word):
    found = [
        f"{where}: {words}, say {INSTEAD[word]}"
        for where, words in matches(METAPHORS[word], TEXTS)
        if not where.startswith(PLAIN.get(word, ("/",)))
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


def test_descriptions_of_parameters_are_no_fragments():
    """A description says what the parameter is, in place of "Of the prices" or "As there"."""
    entry = re.compile(r"(?m)^ *[\w*, ]+ : .*\n +(?:Of|Those of|That of|As there)\b.*")
    found = [
        f"{place(path, getattr(node, 'lineno', 1))}: {match[0].splitlines()[1].strip()[:70]}"
        for path in CODE
        for _, node, text in docstrings(path)
        for match in entry.finditer(text)
    ]
    assert not found


# The packages whose names the reference of the documentation lists.
PUBLIC = re.findall(
    r"automodule:: (\S+)",
    "".join(path.read_text() for path in sorted((ROOT / "docs/reference").glob("*.md"))),
)


def named_in(text: str, name: str) -> bool:
    """Tell whether a docstring names a parameter outside its examples."""
    text = re.sub(r"(?m)^[ \t]*>>>.*\n(?:^[ \t]*\S.*\n?)*", "", text)
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
            own = "\n\n".join(base.__doc__ or "" for base in public.__mro__ if base is not object)
            built = [] if getattr(public, "_is_protocol", False) else parameters(public)
            missing += [f"{name}: {one}" for one in built if not named_in(own, one)]
            for method, function in methods(public):
                text = f"{own}\n\n{function.__doc__}"
                missing += [
                    f"{name}.{method}: {one}" for one in parameters(function) if not named_in(text, one)
                ]
    assert not missing
