"""Start the service, ask it for a price by its client, and see how it refuses what it cannot answer.

`pricing serve` starts the same service on port 8000, with a page for people at its root.

Run it from the root of the project: .venv/bin/python examples/10_service_and_client.py
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

from app.client import Client
from pricing_core.american import Market, Option, price


@contextmanager
def service() -> Iterator[str]:
    """Run the service on a free port, and return its address, which is the first line of its log."""
    program = [Path(sys.executable).with_name("pricing"), "serve", "--port", "0"]
    with subprocess.Popen(program, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            yield f"http://127.0.0.1:{json.loads(process.stderr.readline())['port']}"
        finally:
            process.terminate()


option = Option("put", strike=100.0, expiry=1.0)
market = Market(spot=100.0, rate=0.05, volatility=0.2)
with service() as url:
    with Client(url) as client:
        answer = client.price(option, market)
    print(f"price {answer.price:.5f} +- {answer.error_estimate:.0e}, delta {answer.delta:.5f}")
    # A price comes from the same engine, to the last bit.
    assert answer.price == price(option, market).price

    contract = {
        "option_type": "put",
        "spot": 100,
        "strike": 100,
        "expiry": 1,
        "rate": 0.05,
        "volatility": -0.2,
    }
    refused = httpx.post(f"{url}/v1/price", json=contract)
    problem = refused.json()
    print(f"status {refused.status_code}: {problem['title']}")
    for error in problem["errors"]:
        print(f"  {error}")
    assert refused.status_code == 422
    assert refused.headers["content-type"] == "application/problem+json"
