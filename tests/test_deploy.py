"""What deploy/ says, held against the code, the Dockerfile and the distribution."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.main import create_app
from app.service.server import CONNECT_SECONDS, LAST_SECONDS
from app.service.worker_processes import EXTRA_SECONDS
from app.settings import PREFIX, Settings
from pricing_core import __version__

ROOT = Path(__file__).parents[1]
DEPLOY = ROOT / "deploy"
DOCKERFILE = (ROOT / "Dockerfile").read_text()
IMAGE = f"pricing-core:{__version__}"
COMMENTED = re.compile(r"^(\s*)# ?(PRICING_\w+: .*|secrets:.*|  api_keys:|    file: .*)$", re.MULTILINE)


def documents(path: Path) -> list[dict[str, Any]]:
    return list(yaml.safe_load_all(path.read_text()))


def image_port() -> int:
    (port,) = re.findall(r"^EXPOSE (\d+)$", DOCKERFILE, re.MULTILINE)
    return int(port)


def settings_of(variables: dict[str, str]) -> Settings:
    """Return the settings that these variables give; a name that is none fails."""
    names = {name.removeprefix(PREFIX).lower(): value for name, value in variables.items()}
    assert all(name.startswith(PREFIX) for name in variables)
    assert names.keys() <= Settings.model_fields.keys()
    return Settings(**names)  # type: ignore[arg-type]


def seconds_to_stop(settings: Settings) -> float:
    return settings.drain_seconds + CONNECT_SECONDS + LAST_SECONDS + settings.grace_seconds + EXTRA_SECONDS


def image_settings() -> dict[str, str]:
    return dict(re.findall(rf"\b({PREFIX}\w+)=(\S+)", DOCKERFILE))


@pytest.fixture(params=["as it is", "with keys"])
def compose(request: pytest.FixtureRequest) -> dict[str, Any]:
    text = (DEPLOY / "compose.yaml").read_text()
    if request.param == "with keys":
        text = COMMENTED.sub(r"\1\2", text)
        assert "# secrets" not in text
    return yaml.safe_load(text)


@pytest.fixture
def kubernetes() -> dict[str, dict[str, Any]]:
    found = [one for path in sorted((DEPLOY / "kubernetes").iterdir()) for one in documents(path)]
    return {one["kind"]: one for one in found}


def test_no_file_names_a_registry() -> None:
    for path in DEPLOY.rglob("*.yaml"):
        images = re.findall(r"^\s*image: (\S+)$", path.read_text(), re.MULTILINE)
        assert set(images) <= {IMAGE}, path


def test_compose_runs_the_image_as_it_is_meant_to_run(compose: dict[str, Any]) -> None:
    (service,) = compose["services"].values()
    assert "command" not in service
    (port,) = service["ports"]
    assert port == f"127.0.0.1:{image_port()}:{image_port()}"
    assert service["user"].split(":")[0] == re.findall(r"^USER (\d+)$", DOCKERFILE, re.MULTILINE)[0]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    settings = settings_of(image_settings() | service["environment"])
    assert settings.port == image_port()
    assert int(service["stop_grace_period"].removesuffix("s")) >= seconds_to_stop(settings)
    assert service["ulimits"]["nofile"] > settings.max_connections + 512
    assert (ROOT / "deploy" / service["build"] / "Dockerfile").is_file()
    for secret in service.get("secrets", []):
        assert settings.api_keys_file == f"/run/secrets/{secret}"
        assert secret in compose["secrets"]
    assert bool(settings.api_keys_file) == ("secrets" in service)


def test_the_deployment_runs_the_image_as_it_is_meant_to_run(kubernetes: dict[str, Any]) -> None:
    pod = kubernetes["Deployment"]["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert "command" not in container
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert (
        str(pod["securityContext"]["runAsUser"]) == re.findall(r"^USER (\d+)$", DOCKERFILE, re.MULTILINE)[0]
    )
    assert container["securityContext"]["readOnlyRootFilesystem"] is True
    assert container["securityContext"]["allowPrivilegeEscalation"] is False
    settings = settings_of(image_settings() | {one["name"]: one["value"] for one in container["env"]})
    assert settings.port == image_port()
    assert pod["terminationGracePeriodSeconds"] >= seconds_to_stop(settings)
    assert container["resources"]["limits"].keys() == {"cpu", "memory"}
    mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
    assert mounts.keys() == {volume["name"] for volume in pod["volumes"]}
    assert settings.api_keys_file.startswith(mounts["keys"] + "/")
    readiness = container["readinessProbe"]  # turns before connections are refused
    assert readiness["periodSeconds"] * readiness["failureThreshold"] <= settings.drain_seconds


def test_the_probes_ask_what_is_there(kubernetes: dict[str, Any]) -> None:
    paths = create_app(Settings()).openapi()["paths"]
    template = kubernetes["Deployment"]["spec"]["template"]
    (container,) = template["spec"]["containers"]
    probes = {
        name: container[name]["httpGet"] for name in ("startupProbe", "livenessProbe", "readinessProbe")
    }
    assert {name: probe["path"] for name, probe in probes.items()} == {
        "startupProbe": "/readyz",
        "livenessProbe": "/livez",
        "readinessProbe": "/readyz",
    }
    assert all("get" in paths[probe["path"]] for probe in probes.values())
    (port,) = container["ports"]
    assert port["containerPort"] == image_port()
    assert {probe["port"] for probe in probes.values()} == {port["name"]}
    told = template["metadata"]["annotations"]
    assert told["prometheus.io/path"] in paths
    assert int(told["prometheus.io/port"]) == image_port()


def test_the_manifests_belong_together(kubernetes: dict[str, Any]) -> None:
    deployment = kubernetes["Deployment"]["spec"]
    labels = deployment["template"]["metadata"]["labels"]
    assert deployment["selector"]["matchLabels"].items() <= labels.items()
    assert kubernetes["Service"]["spec"]["selector"].items() <= labels.items()
    assert kubernetes["PodDisruptionBudget"]["spec"]["selector"]["matchLabels"].items() <= labels.items()
    (port,) = kubernetes["Service"]["spec"]["ports"]
    (named,) = deployment["template"]["spec"]["containers"][0]["ports"]
    assert port["targetPort"] == named["name"]


def test_the_image_serves_everyone_on_its_port_and_its_own_check_asks_a_probe_there() -> None:
    settings = settings_of(image_settings())
    assert (settings.host, settings.port) == ("0.0.0.0", image_port())
    (command,) = re.findall(r"^CMD (\[.*\])$", DOCKERFILE, re.MULTILINE)
    assert json.loads(command) == ["pricing", "serve"]
    (check,) = re.findall(r"HEALTHCHECK .*\\\n\s*CMD (\[.*\])$", DOCKERFILE, re.MULTILINE)
    *_, program = json.loads(check)
    assert """f'http://127.0.0.1:{os.environ["PRICING_PORT"]}/livez'""" in program
