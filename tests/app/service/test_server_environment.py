"""A real server that finds in environment variables where to listen and how many processes to start."""

import json
import os
import subprocess
import sys
import time
import urllib.request

import pytest

from tests.app.service.server_process import children


@pytest.mark.parametrize(
    ("options", "variables", "host", "processes"),
    [
        ([], {"HOST": "127.0.0.2", "PORT": "0", "WORKERS": "2"}, "127.0.0.2", 2),
        (["--host", "127.0.0.1", "--workers", "1"], {"HOST": "127.0.0.2", "PORT": "0", "WORKERS": "2"}, "127.0.0.1", 0),
        (["--port", "0"], {"PORT": "tcp://10.0.0.1:80", "SERVICE_PORT": "80"}, "127.0.0.1", 0),
    ],
)  # fmt: skip
def test_a_server_listens_where_the_variables_say_unless_options_do(
    options: list[str], variables: dict[str, str], host: str, processes: int
) -> None:
    named = {f"PRICING_{name}": value for name, value in variables.items()}
    with subprocess.Popen(
        [sys.executable, "-m", "app", "serve", *options],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | named | {"PRICING_DRAIN_SECONDS": "0", "PRICING_LOG_LEVEL": "INFO"},
    ) as process:
        try:
            assert process.stderr is not None
            listening = json.loads(process.stderr.readline())
            assert listening["host"] == host
            with urllib.request.urlopen(f"http://{host}:{listening['port']}/readyz", timeout=60) as answer:
                assert answer.status == 200
            for _ in range(600):  # the last process may start after the first has answered
                if len(children(process.pid)) == processes:
                    break
                time.sleep(0.1)
            assert len(children(process.pid)) == processes
        finally:
            process.terminate()
            process.communicate()
    assert process.returncode == 0
