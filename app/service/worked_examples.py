"""Answers to the examples of the OpenAPI description, to six digits; a test asks for them and compares."""

from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI

from pricing_core.version import ENGINE_VERSION

# By address: the answer to the example of its request.
ANSWERS: Mapping[str, Any] = {
    "/v1/price": {
        "price": 6.09036,
        "european_price": 5.57353,
        "early_exercise_premium": 0.516831,
        "intrinsic_value": 0.0,
        "delta": -0.411059,
        "gamma": 0.0229888,
        "theta": -2.23795,
        "theta_per_day": -0.00613137,
        "vega": 37.4878,
        "vega_per_point": 0.374878,
        "rho": -30.2175,
        "rho_per_point": -0.302175,
        "dividend_rho": 26.863,
        "delta_sticky_moneyness": None,
        "exercise_now": False,
        "exercise_boundary": 80.8751,
        "error_estimate": 6.80749e-05,
        "status": "ok",
        "method": "premium-march",
        "engine_version": ENGINE_VERSION,
        "instruction_set": "avx512",
        "dividend_sensitivities": None,
        "vanna": None,
        "volga": None,
        "charm": None,
        "rate_buckets": None,
        "dividend_yield_buckets": None,
        "volatility_buckets": None,
        "greeks_units": "per_year_per_unit",
    },
    "/v1/boundary": {
        "time": [0.0, 0.5, 1.0],
        "time_to_expiry": [1.0, 0.5, 0.0],
        "boundary": [80.8751, 83.9196, 100.0],
        "other_boundary": None,
        "error_estimate": [0.00040654, 0.000361339, 0.0],
        "method": "premium-march",
        "engine_version": ENGINE_VERSION,
        "instruction_set": "avx512",
    },
    "/v1/implied-volatility": {
        "volatility": 0.19999,
        "status": "ok",
        "european_price": 5.57316,
        "price": 6.09,
        "bid_volatility": None,
        "ask_volatility": None,
        "error_estimate": 2.08997e-05,
        "volatility_error": 5.58997e-07,
        "iterations": 4,
        "method": "premium-march",
        "price_bound": None,
        "message": "",
        "engine_version": ENGINE_VERSION,
        "instruction_set": "avx512",
    },
    "/v1/surface": {
        "time": [0.0, 0.5],
        "spot": [80.0, 100.0, 120.0],
        "value": [[20.0, 6.09036, 1.3671], [20.0, 4.65568, 0.497571]],
        "delta": [[-1.0, -0.411059, -0.111046], [-1.0, -0.432312, -0.0643501]],
        "gamma": [[0.0, 0.0229888, 0.00822644], [0.0, 0.0308529, 0.00753421]],
        "theta": [[0.0, -2.23795, -1.63459], [0.0, -3.77623, -1.75887]],
        "vega": [[0.0, 37.4878, 22.5209], [0.0, 27.2468, 10.6446]],
        "multiplier": [[5.0, 0.0, 0.0], [5.0, 0.0, 0.0]],
        "exercised": [[True, False, False], [True, False, False]],
        "error_estimate": [[8e-15, 6.80749e-05, 4.79128e-05], [8e-15, 6.35933e-05, 2.92361e-05]],
        "perpetual_boundary": 71.4286,
        "status": "ok",
        "method": "premium-march",
        "greeks_units": "per_year_per_unit",
        "engine_version": ENGINE_VERSION,
        "instruction_set": "avx512",
    },
    "/v1/exercise-advice": {
        "exercise_now": False,
        "exercise_boundary": 80.8751,
        "probability": 0.487361,
        "probability_error": 1.14037e-05,
        "expected_time": 0.643705,
        "exercised_at_expiry": 0.0,
        "expires_worthless": 0.512639,
        "time": [0.5, 1.0],
        "cumulative_probability": [0.163747, 0.487361],
        "assignment_probability": [0.163747, 0.487361],
        "cost_of_waiting": [0.0714273, 0.516831],
        "cost_error": [0.000154459, 6.80749e-05],
        "status": "ok",
        "method": "closed-form, obstacle-march, premium-march",
        "engine_version": ENGINE_VERSION,
        "instruction_set": "avx512",
    },
    "/v1/batch": {
        "greeks_units": "per_year_per_unit",
        "price": [11.4927, 17.663],
        "european_price": [10.2142, 17.663],
        "early_exercise_premium": [1.27854, 0.0],
        "intrinsic_value": [10.0, 10.0],
        "delta": [-0.683268, 0.795754],
        "gamma": [0.0312804, 0.0128865],
        "theta": [-1.41808, -6.61204],
        "theta_per_day": [-0.00388514, -0.0181152],
        "vega": [28.8965, 31.1854],
        "vega_per_point": [0.288965, 0.311854],
        "rho": [-29.4318, 69.87],
        "rho_per_point": [-0.294318, 0.6987],
        "dividend_rho": [25.6032, -87.533],
        "delta_sticky_moneyness": [None, None],
        "exercise_now": [False, False],
        "exercise_boundary": [80.8751, None],
        "error_estimate": [9.15371e-05, 2.09879e-13],
        "status": ["ok", "ok"],
        "method": ["premium-march", "closed-form"],
        "engine_version": [ENGINE_VERSION, ENGINE_VERSION],
        "instruction_set": ["avx512", "avx512"],
        "message": [None, None],
    },
}


def install_examples(app: FastAPI) -> None:
    """Show the answers in the application's description: its own way leaves out what is null."""
    describe = app.openapi

    def described() -> dict[str, Any]:
        description = describe()
        for path, answer in ANSWERS.items():
            content = description["paths"][path]["post"]["responses"]["200"]["content"]
            content["application/json"]["example"] = answer
        return description

    app.openapi = described  # type: ignore[method-assign]
