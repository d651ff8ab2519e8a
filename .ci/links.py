"""Follow every link inside the built site and inside the repository's Markdown files, anchors included: `make docs`.

Links to other sites are not followed, for the check needs no network; but a page of the site that loads a file from
elsewhere fails.
"""

import re
import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).parents[1]
SITE = ROOT / "site"
MARKDOWN = (
    "*.md",
    ".github/**/*.md",
    "{app,benchmarks,deploy,docs,examples,kernels,licenses,pricing_core,tests}/**/*.md",
)
LOADING = {"script", "img", "iframe", "source", "video", "audio", "embed"}


class Page(HTMLParser):
    """The anchors of an HTML page, what it links to, and what a browser loads for it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Take the anchors and links of one element."""
        values = {name: value for name, value in attributes if value}
        self.anchors.update(values[name] for name in ("id", "name") if name in values)
        links = [values[name] for name in ("href", "src") if name in values]
        self.links += links
        if tag in LOADING or (tag == "link" and values.get("rel") in ("stylesheet", "icon", "preload")):
            self.loaded += links


def main() -> None:
    """Print every broken link, and fail where there is one."""
    pages = sorted(SITE.rglob("*.html"))
    texts = [path for pattern in MARKDOWN for path in sorted(found(pattern))]
    if not pages:
        sys.exit(f"{SITE} holds no page: `make docs` builds it")
    broken = [problem for path in (*pages, *texts) for problem in problems(path)]
    for problem in broken:
        print(problem, file=sys.stderr)
    if broken:
        sys.exit(f"{len(broken)} broken links")
    print(f"every link inside {len(pages)} pages and {len(texts)} Markdown files leads somewhere")


def found(pattern: str) -> Iterator[Path]:
    """Yield the files of a pattern, whose first part may be a choice in braces."""
    choice = re.fullmatch(r"\{(.*)\}(.*)", pattern)
    for one in [f"{name}{choice[2]}" for name in choice[1].split(",")] if choice else [pattern]:
        yield from ROOT.glob(one)


def problems(path: Path) -> list[str]:
    """Return what is wrong with the links of one file."""
    place = path.relative_to(ROOT)
    faults = [f"{place}: loads {link} from elsewhere" for link in loaded(path) if is_elsewhere(link)]
    for link in links(path):
        parts = urlsplit(link)
        if is_elsewhere(link) or link.startswith(("data:", "mailto:", "tel:", "javascript:")):
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        if target.is_dir() and path.suffix == ".html":
            target /= "index.html"
        if not target.exists():
            faults.append(f"{place}: {link} leads to no file")
        elif parts.fragment and unquote(parts.fragment) not in anchors(target):
            faults.append(f"{place}: {link} leads to no anchor")
    return faults


def is_elsewhere(link: str) -> bool:
    """Tell whether a link leads to another site."""
    return urlsplit(link).scheme in ("http", "https") or link.startswith("//")


@cache
def page(path: Path) -> Page:
    """Return an HTML page, read once."""
    return Page(path.read_text(encoding="utf-8"))


@cache
def tokens(path: Path) -> list[Token]:
    """Return a Markdown file in its parts, read once."""
    return MarkdownIt("commonmark").enable("table").parse(path.read_text(encoding="utf-8"))


def links(path: Path) -> list[str]:
    """Return the links of a file."""
    if path.suffix == ".html":
        return page(path).links
    inside = [one for token in tokens(path) for one in token.children or []]
    marked = [str(one.attrs.get("href") or one.attrs.get("src") or "") for one in inside]
    raw = [link for token in tokens(path) if token.type == "html_block" for link in Page(token.content).links]
    return [link for link in (*marked, *raw) if link]


def images(path: Path) -> list[str]:
    """Return the images inside the repository that a Markdown file shows."""
    inside = [one for token in tokens(path) for one in token.children or [] if one.type == "image"]
    return [link for one in inside if not is_elsewhere(link := str(one.attrs["src"]))]


def loaded(path: Path) -> list[str]:
    """Return what a browser loads together with a page."""
    return page(path).loaded if path.suffix == ".html" else []


def anchors(path: Path) -> set[str]:
    """Return the anchors of a file: those of a page, or the headings of a Markdown file as they are linked to."""
    if path.suffix == ".html":
        return page(path).anchors
    return set(headings(path)) if path.suffix == ".md" else set()


def headings(path: Path) -> Iterator[str]:
    """Yield the anchor of each heading: lower case, hyphens for spaces, a number where it is repeated."""
    seen: dict[str, int] = {}
    for before, token in zip(tokens(path), tokens(path)[1:], strict=False):
        if before.type == "heading_open":
            text = "".join(one.content for one in token.children or [] if one.type in ("text", "code_inline"))
            slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
            yield f"{slug}-{seen[slug]}" if slug in seen else slug
            seen[slug] = seen.get(slug, 0) + 1


if __name__ == "__main__":
    main()
