"""Run the steps of the Dockerfile without a container engine: `make image`.

Every stage is an empty folder in the place of its root, with an environment that holds nothing but PATH and what the
stage sets. What belongs to the system is taken from this machine: the lines of apt-get and useradd are not run, and the
user stays the same. In the end the server is started as the image starts it, asked whether it is healthy, and asked for
a price.
"""

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SYSTEM = ("apt-get", "useradd")  # Commands of the lines that are left to the base image.
INSIDE = re.compile(r"(?<![\w./-])/(src|opt)\b")  # The absolute paths that lie in a stage's folder.
CONTRACT = {"option_type": "put", "spot": 100, "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
PRICE = 6.0903
SECONDS = 60.0  # that the server may take until it is healthy


@dataclass
class Stage:
    """What the instructions of one stage have made so far."""

    root: Path
    folder: Path
    variables: dict[str, str]
    health: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)

    def inside(self, text: str) -> str:
        """Return a text with the absolute paths of the stage as they are on this machine."""
        return INSIDE.sub(lambda found: f"{self.root}/{found[1]}", text)


def main() -> None:
    """Build the stages, and try the last one."""
    with tempfile.TemporaryDirectory(prefix="image-") as name:
        scratch = Path(name)
        scratch.chmod(0o755)
        stages: dict[str, Stage] = {}
        stage: Stage | None = None
        for instruction, arguments in instructions((ROOT / "Dockerfile").read_text()):
            if instruction == "FROM":
                base, *alias = re.split(r"\s+AS\s+", arguments)
                key = alias[0] if alias else "final"
                stage = stages[key] = empty_stage(scratch / key)
                print(f"=== stage {key}, on {base}", flush=True)
            elif stage is None:
                sys.exit(f"{instruction} stands before FROM")
            else:
                follow(instruction, arguments, stage, stages)
        if stage is not None:
            serve(stage)


def instructions(text: str) -> list[tuple[str, str]]:
    """Return the instructions of a Dockerfile with their arguments."""
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    whole = lines.replace("\\\n", " ")
    return [
        (name, rest.strip()) for name, rest in (line.split(None, 1) for line in whole.splitlines() if line)
    ]


def empty_stage(root: Path) -> Stage:
    """Return a stage in a new folder; PATH, where this machine keeps Rust, and how cargo compiles are taken over."""
    (root / "opt").mkdir(parents=True)
    home = Path.home()
    variables = {"PATH": os.environ["PATH"], "HOME": str(root)}
    for name, default in (("CARGO_HOME", home / ".cargo"), ("RUSTUP_HOME", home / ".rustup")):
        variables[name] = os.environ.get(name, str(default))
    variables |= {name: value for name, value in os.environ.items() if name.startswith("CARGO_")}
    return Stage(root, root, variables)


def follow(instruction: str, arguments: str, stage: Stage, stages: dict[str, Stage]) -> None:
    """Do what one instruction says."""
    if instruction == "RUN":
        run(arguments, stage)
    elif instruction == "COPY":
        copy(shlex.split(arguments), stage, stages)
    elif instruction == "WORKDIR":
        stage.folder = Path(stage.inside(arguments))
        stage.folder.mkdir(parents=True, exist_ok=True)
    elif instruction == "ENV":
        for setting in shlex.split(arguments):
            name, value = setting.split("=", 1)
            stage.variables[name] = stage.inside(value).replace("$PATH", stage.variables["PATH"])
    elif instruction == "HEALTHCHECK":
        stage.health = json.loads(arguments[arguments.index("[") :])
    elif instruction == "CMD":
        stage.command = json.loads(arguments)
    elif instruction not in ("USER", "EXPOSE"):
        sys.exit(f"{instruction} is not known here")


def run(command: str, stage: Stage) -> None:
    """Run a line as the shell would."""
    if command.startswith(SYSTEM):
        print(f"left to the base image: {command}", flush=True)
        return
    print(f"RUN {' '.join(command.split())}", flush=True)
    done = subprocess.run(
        stage.inside(command), shell=True, cwd=stage.folder, env=stage.variables, check=False
    )
    if done.returncode != 0:
        sys.exit(f"failed with {done.returncode}: {command}")


def copy(words: list[str], stage: Stage, stages: dict[str, Stage]) -> None:
    """Copy from the source tree, less what .dockerignore leaves out, or from another stage."""
    source, ignored = ROOT, ignore_rules()
    if words[0].startswith("--from="):
        other = stages[words.pop(0).removeprefix("--from=")]
        source, ignored = other.root, []
    *names, target = words
    destination = stage.folder / stage.inside(target)
    for name in names:
        found = source / name.lstrip("/")
        files = [found] if found.is_file() else sorted(path for path in found.rglob("*") if path.is_file())
        kept = [path for path in files if not is_left_out(path.relative_to(source), ignored)]
        if not kept:
            sys.exit(f"COPY {name}: .dockerignore leaves out all of it, or it is missing")
        for path in kept:
            place = destination / path.relative_to(found) if found.is_dir() else destination
            place = place / path.name if target.endswith("/") else place
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, place)


def ignore_rules() -> list[tuple[str, bool]]:
    """Return the patterns of .dockerignore, each with whether it leaves out what it matches."""
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    return [(line.lstrip("!"), line[0] != "!") for line in lines if line and line[0] != "#"]


def is_left_out(path: Path, rules: list[tuple[str, bool]]) -> bool:
    """Tell whether a file is left out: the last pattern that matches it, or a folder that it is in, counts."""
    left_out = False
    for pattern, leaves_out in rules:
        shown = [str(path), *map(str, path.parents)]
        anywhere = pattern.removeprefix("**/")
        names = path.parts if anywhere != pattern else ()
        if any(fnmatch(part, anywhere) for part in names) or any(
            fnmatch(one, pattern) and one.count("/") == pattern.count("/") for one in shown
        ):
            left_out = leaves_out
    return left_out


def serve(stage: Stage) -> None:
    """Start the server, ask whether it is healthy, and ask for a price."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    command, health = stage.command, stage.health
    print("CMD", *command, flush=True)
    options: dict[str, Any] = {"cwd": stage.folder, "env": stage.variables | {"PRICING_PORT": port}}
    command[0] = shutil.which(command[0], path=stage.variables["PATH"]) or command[0]
    health[0] = shutil.which(health[0], path=stage.variables["PATH"]) or health[0]
    server = subprocess.Popen(command, **options)
    try:
        deadline = time.monotonic() + SECONDS
        while subprocess.run(health, capture_output=True, check=False, **options).returncode != 0:
            if time.monotonic() > deadline or server.poll() is not None:
                sys.exit("the server did not become healthy")
            time.sleep(0.2)
        question = urllib.request.Request(
            f"http://127.0.0.1:{port}/v1/price",
            json.dumps(CONTRACT).encode(),
            {"Content-Type": "application/json"},
        )
        with urllib.request.urlopen(question, timeout=10.0) as answer:
            found = json.load(answer)
    finally:
        server.terminate()
        status = server.wait(30.0)
    if abs(found["price"] - PRICE) > 1e-4 or found["status"] != "ok" or status != 0:
        sys.exit(f"the image answers {found}, and ends with {status}")
    print(f"healthy; a price over HTTP: {found['price']:.6f}", flush=True)


if __name__ == "__main__":
    main()
