"""The page as it is sent, without a browser."""

import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from app.service.routes.page import FILES, FOLDER

VENDORED = (FOLDER / "uplot", Path(__file__).parents[2] / "page" / "axe")
ADDRESS = re.compile(r'(?:src|href)="(page/[^"]+)"')


class Tags(HTMLParser):
    """Collects tags with their attributes, and the text inside scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.inline = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.found and self.found[-1][0] in ("script", "style"):
            self.inline += data.strip()


@pytest.mark.parametrize("folder", VENDORED, ids=lambda folder: folder.name)
def test_what_others_wrote_is_as_they_published_it(folder: Path) -> None:
    lines = (folder / "SHA256SUMS").read_text().splitlines()
    stated = dict(reversed(line.split()) for line in lines)
    assert set(stated) == {path.name for path in folder.iterdir()} - {"SHA256SUMS"}
    for name, digest in stated.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name
    assert "LICENSE" in stated


def test_the_page_has_a_strict_policy_and_nothing_inline(client: TestClient) -> None:
    answer = client.get("/")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'"
    assert {policy[name] for name in ("script-src", "style-src", "connect-src")} == {"'self'"}
    page = Tags(answer.text)
    assert page.inline == ""
    assert not [
        attrs for _, attrs in page.found if "style" in attrs or any(key.startswith("on") for key in attrs)
    ]


def test_every_file_that_the_page_and_its_modules_name_is_sent_to_be_kept(client: TestClient) -> None:
    addresses = ADDRESS.findall(client.get("/").text)
    assert len(addresses) == 5
    folder = addresses[0].rsplit("/", 1)[0]
    modules = {name for name in FILES if name.endswith(".js") and "/" not in name}
    named = {
        name for file in modules for name in re.findall(r'from "\./(\w+\.js)"', FILES[file].body.decode())
    }
    assert named == modules - {"main.js"}
    for address in {*addresses, *(f"{folder}/{name}" for name in modules)}:
        answer = client.get(f"/{address}")
        assert answer.status_code == 200, address
        assert "immutable" in answer.headers["cache-control"]
        again = client.get(f"/{address}", headers={"If-None-Match": answer.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")


def test_the_page_is_asked_for_anew_and_sent_only_where_it_has_changed(client: TestClient) -> None:
    first = client.get("/")
    assert first.headers["cache-control"] == "no-cache"
    assert client.get("/", headers={"If-None-Match": first.headers["etag"]}).status_code == 304
    assert client.get("/", headers={"If-None-Match": '"other"'}).status_code == 200


@pytest.mark.parametrize(
    "name", ["../main.py", "%2e%2e/main.py", "index.html", "none.js", "", "uplot/SHA256SUMS"]
)
def test_no_other_file_is_sent(client: TestClient, name: str) -> None:
    (address, *_) = ADDRESS.findall(client.get("/").text)
    folder = "/".join(address.split("/")[:2])
    assert client.get(f"/{folder}/{name}").status_code == 404
    assert client.get("/page/0000000000000000/main.js").status_code == 404
