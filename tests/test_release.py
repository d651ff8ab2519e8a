"""What a release consists of: a version, licence texts, workflows, a reproducible sdist, links that lead somewhere."""

import importlib.util
import io
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest
import yaml

import pricing_core
from pricing_core import kernel

ROOT = Path(__file__).parents[1]


def script(name):
    """Return a script of `.ci` as a module."""
    described = importlib.util.spec_from_file_location(f"ci_{name}", ROOT / ".ci" / f"{name}.py")
    module = importlib.util.module_from_spec(described)
    described.loader.exec_module(module)
    return module


class TestVersion:
    def test_is_the_same_wherever_it_is_stated(self):
        assert set(script("version").versions().values()) == {pricing_core.__version__}
        assert "release = version = __version__" in (ROOT / "docs/conf.py").read_text()

    @pytest.mark.skipif(pricing_core.kernel_name() != "rust", reason="no kernel is compiled")
    def test_is_that_of_the_kernel(self):
        assert kernel._compiled.__version__ == pricing_core.__version__

    def test_no_other_file_states_it(self):
        """A version in code or texts would be forgotten; a changelog tells of versions that there were."""
        version = re.compile(rf"(?<![\d.]){re.escape(pricing_core.__version__)}(?![\d.]*\d)")
        places = {*script("version").PLACES, "CHANGELOG.md"}
        files = [
            path
            for folder in ("app", "pricing_core", "deploy", "docs", ".github")
            for path in (ROOT / folder).rglob("*")
            if path.suffix in (".py", ".md", ".toml", ".yaml", ".yml", ".html", ".js")
        ]
        stating = {str(path.relative_to(ROOT)) for path in files if version.search(path.read_text())}
        assert stating <= places

    def test_is_written_into_every_file_with_a_heading_of_the_changelog(self, tmp_path):
        version = script("version")
        for name in (*version.PLACES, "CHANGELOG.md"):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tmp_path / name)
        version.write("7.8.9rc1", tmp_path)
        assert set(version.versions(tmp_path).values()) == {"7.8.9rc1"}
        for name in version.PLACES:
            now, before = (tmp_path / name).read_text(), (ROOT / name).read_text()
            assert now.replace("7.8.9rc1", pricing_core.__version__) == before, name
        assert re.search(
            r"## \[Unreleased\]\n\n## \[7\.8\.9rc1\] - \d{4}-\d\d-\d\d\n",
            (tmp_path / "CHANGELOG.md").read_text(),
        )

    @pytest.mark.parametrize("wrong", ["1.2", "v1.2.3", "1.2.3-beta", ""])
    def test_that_is_none_is_refused(self, wrong):
        with pytest.raises(SystemExit, match="is no version"):
            script("version").write(wrong)


class TestLicenses:
    def test_every_crate_has_its_texts(self):
        lock = tomllib.loads((ROOT / "kernels/Cargo.lock").read_text())
        crates = {f"{one['name']}-{one['version']}.txt" for one in lock["package"] if "source" in one}
        assert len(crates) > 20
        held = {path.name for path in (ROOT / "licenses").glob("*.txt")}
        assert held == crates | {"rust-standard-library.txt"}, "make licenses"

    def test_each_text_names_its_licence_and_a_copyright(self):
        for path in (ROOT / "licenses").glob("*.txt"):
            text = path.read_text()
            assert re.search(r"(?m)^Licence: .*(MIT|BSD|Apache)", text), path.name
            assert re.search(
                r"(?i)permission is hereby granted|redistribution and use|apache license", text
            ), path.name

    def test_the_standard_library_is_that_of_the_pinned_toolchain(self):
        first = (ROOT / "licenses/rust-standard-library.txt").read_text().splitlines()[0]
        version = re.fullmatch(r"The standard library of Rust (\d+\.\d+\.\d+)", first)[1]
        assert f"FROM rust:{version}-" in (ROOT / "Dockerfile").read_text()
        for workflow in (ROOT / ".github/workflows").iterdir():
            assert set(re.findall(r"\d+\.\d+\.\d+(?= --profile)", workflow.read_text())) == {version}

    def test_they_are_part_of_the_distribution(self):
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        files = {path for pattern in project["license-files"] for path in ROOT.glob(pattern)}
        assert files == {
            ROOT / "LICENSE",
            ROOT / "app/page/uplot/LICENSE",
            *(ROOT / "licenses").glob("*.txt"),
        }


class TestWorkflows:
    def workflow(self, name):
        return yaml.safe_load((ROOT / ".github/workflows" / name).read_text())

    def test_one_makes_every_check(self):
        steps = self.workflow("checks.yml")["jobs"]["checks"]["steps"]
        assert steps[-1]["run"] == ".ci/run"

    def test_one_builds_for_every_platform(self):
        job = self.workflow("wheels.yml")["jobs"]["wheels"]
        built = {one["platform"] for one in job["strategy"]["matrix"]["include"]}
        assert built == {"linux-x86_64", "linux-aarch64", "macos-x86_64", "macos-arm64", "windows-x86_64"}

    def test_their_python_is_the_oldest_that_is_served(self):
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        for path in (ROOT / ".github/workflows").iterdir():
            assert re.findall(r'python-version: "(.*)"', path.read_text()) == [
                project["requires-python"].removeprefix(">=")
            ]


def sdist(source, moment):
    """Build the sdist of a source tree as pip's front ends do, and return its bytes."""
    code = f"from setuptools.build_meta import build_sdist; print(build_sdist({str(source / 'out')!r}))"
    environment = {"PATH": "/usr/bin:/bin", "PRICING_CORE_KERNEL": "none", "SOURCE_DATE_EPOCH": str(moment)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=source, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return (source / "out" / done.stdout.splitlines()[-1]).read_bytes()


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return a copy of the files that an sdist of the library is made from."""
    folder = tmp_path_factory.mktemp("source")
    for name in ("LICENSE", "MANIFEST.in", "README.md", "pyproject.toml", "setup.py", "CHANGELOG.md"):
        shutil.copy(ROOT / name, folder / name)
    for name in ("kernels/src", "licenses", "pricing_core", "app"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    shutil.copy(ROOT / "kernels/Cargo.toml", folder / "kernels")
    return folder


class TestSdist:
    def test_two_builds_are_the_same_bit_for_bit(self, source, tmp_path):
        first = sdist(source, 1_700_000_000)
        with tarfile.open(fileobj=io.BytesIO(first)) as archive:
            archive.extraction_filter = getattr(
                tarfile, "data_filter", None
            )  # Python 3.11.4 has it, 3.11.2 not
            archive.extractall(tmp_path)
        (again,) = tmp_path.iterdir()
        for path in again.rglob("*"):  # Later, and with other permissions.
            path.touch()
            path.chmod(0o700 if path.is_dir() else 0o600)
        assert sdist(again, 1_700_000_000) == first

    def test_its_files_are_as_old_as_asked(self, source):
        with tarfile.open(fileobj=io.BytesIO(sdist(source, 1_600_000_000))) as archive:
            members = archive.getmembers()
        assert {one.mtime for one in members} == {1_600_000_000}
        assert {(one.uid, one.gid, one.uname, one.gname) for one in members} == {(0, 0, "", "")}
        names = {one.name.partition("/")[2] for one in members}
        assert {"PKG-INFO", "pyproject.toml", "licenses/pyo3-0.30.1.txt", "kernels/Cargo.toml"} <= names
        assert not [name for name in names if name.endswith((".pyc", ".so")) or "egg-info" in name]


@pytest.fixture
def links(tmp_path, monkeypatch):
    """Return the script that follows links, on a tree of its own."""
    module = script("links")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "SITE", tmp_path / "site")
    (tmp_path / "site").mkdir()
    return module


class TestLinks:
    PAGE = (
        '<h1 id="top">Title</h1><a href="other.html#there">a</a><a href="#top">b</a><a href="x%20y.css">c</a>'
    )

    def test_that_lead_somewhere_pass(self, links, tmp_path, capsys):
        (tmp_path / "site/index.html").write_text(self.PAGE + '<a href="https://elsewhere.example/#x">d</a>')
        (tmp_path / "site/other.html").write_text('<p id="there"></p>')
        (tmp_path / "site/x y.css").write_text("")
        (tmp_path / "README.md").write_text(
            "# A `b` c!\n\n## A b c\n\n[x](#a-b-c-1) [y](site/other.html#there) [z](.)\n"
        )
        links.main()
        assert "inside 2 pages and 1 Markdown files" in capsys.readouterr().out

    @pytest.mark.parametrize(
        ("name", "text", "problem"),
        [
            ("site/a.html", '<a href="gone.html">x</a>', "gone.html leads to no file"),
            ("site/a.html", '<a href="#gone">x</a>', "#gone leads to no anchor"),
            ("site/a.html", '<a href="index.html#gone">x</a>', "index.html#gone leads to no anchor"),
            ("site/a.html", '<img src="https://elsewhere.example/x.png">', "from elsewhere"),
            ("README.md", "[x](gone.md)", "gone.md leads to no file"),
            ("README.md", "# One\n\n[x](#two)", "#two leads to no anchor"),
            ("README.md", "![x](gone.png)", "gone.png leads to no file"),
            ("README.md", '<img src="gone.png">\n', "gone.png leads to no file"),
        ],
    )
    def test_that_lead_nowhere_are_named(self, links, tmp_path, capsys, name, text, problem):
        (tmp_path / "site/index.html").write_text("<p>")
        (tmp_path / name).write_text(text)
        with pytest.raises(SystemExit, match="1 broken links"):
            links.main()
        told = capsys.readouterr().err
        assert told.startswith(f"{name}: ")
        assert problem in told
