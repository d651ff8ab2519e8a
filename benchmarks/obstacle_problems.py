"""How often does the error of an obstacle problem lie within its estimate, family by family, and what does it cost?

Random problems of ten families, each solved to a random tolerance and held against a value that shares nothing with the
averaged complementarity function: closed forms (lognormal options, barriers, constant elasticity, coefficients that
jump, Vasicek's bonds), the option engine's other methods, and for capped calls and callable puts a nodal
complementarity problem on three grids with the kink on a node, extrapolated. Run from the root of the project:
.venv/bin/python -m benchmarks.obstacle_problems [--quick]
"""

import math
import sys
from collections.abc import Callable
from itertools import pairwise
from time import process_time
from typing import NamedTuple

import numpy as np
from scipy.stats import ncx2, norm

from benchmarks.reporting.report import table
from pricing_core.american import CashDividend, Market, Option, price
from pricing_core.american.contracts.fields import Exercise
from pricing_core.obstacle import Diffusion, Event, Held, Obstacle, ObstacleProblem, nodal_method, solve
from pricing_core.obstacle.ends import End
from pricing_core.stepping import SDIRK2, integrate
from pricing_core.stepping.controller import FixedStep

PUT = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0), kinks=[0.0])
CALL = Obstacle(lambda x: np.maximum(np.exp(x) - 1.0, 0.0), kinks=[0.0])
PRICES: tuple[End, End] = ("exponential", "exponential")
NODAL_CELLS = 200  # of the coarsest nodal problem, over twelve standard deviations


class Question(NamedTuple):
    """A problem, the place where it is asked, its value, and how far that may be off itself."""

    problem: ObstacleProblem
    x: float
    value: float
    uncertain: float


class Terms(NamedTuple):
    """A lognormal price: rate, yield, volatility, years, and where it stands."""

    rate: float
    dividend_yield: float
    volatility: float
    expiry: float
    x: float

    @property
    def diffusion(self) -> Diffusion:
        """Of ln S."""
        drift = self.rate - self.dividend_yield - self.volatility**2 / 2.0
        return Diffusion(self.volatility, drift, self.rate)

    def european(self, *, call: bool, spot: float | None = None) -> float:
        """Return the price of Black and Scholes for a strike of 1."""
        s = math.exp(self.x) if spot is None else spot
        deviation = self.volatility * math.sqrt(self.expiry)
        d = (math.log(s) + (self.rate - self.dividend_yield) * self.expiry) / deviation + deviation / 2.0
        sign = 1.0 if call else -1.0
        forward, bond = s * math.exp(-self.dividend_yield * self.expiry), math.exp(-self.rate * self.expiry)
        return float(sign * (forward * norm.cdf(sign * d) - bond * norm.cdf(sign * (d - deviation))))


def terms(rng: np.random.Generator) -> Terms:
    """Return random terms: weeks to years, 8 to 90 %, rates of either sign."""
    volatility = math.exp(rng.uniform(math.log(0.08), math.log(0.9)))
    expiry = math.exp(rng.uniform(math.log(1 / 52), math.log(6.0)))
    x = rng.uniform(-1.5, 1.5) * volatility * math.sqrt(expiry)
    return Terms(rng.uniform(-0.02, 0.12), rng.uniform(-0.02, 0.08), volatility, expiry, x)


def european(rng: np.random.Generator) -> Question:
    """Return a European put or call."""
    given, call = terms(rng), bool(rng.random() < 0.5)
    problem = ObstacleProblem(given.diffusion, CALL if call else PUT, given.expiry, ends=PRICES)
    return Question(problem, given.x, given.european(call=call), 0.0)


def _contract(rng: np.random.Generator, *, dividends: int = 0, dates: int = 0) -> Question:
    given, call = terms(rng), bool(rng.random() < 0.5)
    payoff, T = (CALL if call else PUT), given.expiry
    ex_times, amounts = np.sort(rng.uniform(0.02, 0.98, dividends)) * T, rng.uniform(0.001, 0.03, dividends)
    cash = tuple(CashDividend(t, d) for t, d in zip(ex_times.tolist(), amounts.tolist(), strict=True))
    times = (np.sort(rng.uniform(0.05, 0.95, dates)) * T).tolist()
    market = Market(math.exp(given.x), given.rate, given.volatility, given.dividend_yield, cash)
    style: Exercise = "bermudan" if dates else "american"
    contract = Option("call" if call else "put", 1.0, T, style, tuple(times))
    found = price(contract, market, tolerance=1e-7)
    assert found.price is not None
    assert found.error_estimate is not None
    lower = Obstacle(payoff.value, kinks=[0.0], at=times) if dates else payoff
    events = [Event(one.time, move=_less(one.amount)) for one in cash]
    problem = ObstacleProblem(given.diffusion, payoff, T, lower=lower, events=events, ends=PRICES)
    return Question(problem, given.x, found.price, found.error_estimate)


def _less(amount: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the move of ln S when S drops by an amount."""
    return lambda x: np.log(np.maximum(np.exp(x) - amount, 1e-12))


def american(rng: np.random.Generator) -> Question:
    """Return an American put or call without dividends."""
    return _contract(rng)


def with_dividends(rng: np.random.Generator) -> Question:
    """Return an American put or call with one to eight cash dividends."""
    return _contract(rng, dividends=int(rng.integers(1, 9)))


def bermudan(rng: np.random.Generator) -> Question:
    """Return a Bermudan put or call with one to six dates."""
    return _contract(rng, dates=int(rng.integers(1, 7)))


def barrier(rng: np.random.Generator) -> Question:
    """Return an up-and-out call (Reiner and Rubinstein 1991)."""
    given = terms(rng)
    deviation = given.volatility * math.sqrt(given.expiry)
    level = max(given.x, 0.0) + rng.uniform(0.5, 2.0) * deviation
    mu = (given.rate - given.dividend_yield) / given.volatility**2 - 0.5
    forward = math.exp(given.x - given.dividend_yield * given.expiry)
    bond = math.exp(-given.rate * given.expiry)

    def part(sign: float, log_ratio: float, power: float) -> float:
        d = log_ratio / deviation + (1.0 + mu) * deviation
        first = forward * math.exp(2.0 * (mu + 1.0) * power) * norm.cdf(sign * d)
        return float(first - bond * math.exp(2.0 * mu * power) * norm.cdf(sign * (d - deviation)))

    mirror = level - given.x
    value = part(1.0, given.x, 0.0) - part(1.0, -mirror, 0.0)
    value += part(-1.0, 2.0 * level - given.x, mirror) - part(-1.0, mirror, mirror)
    problem = ObstacleProblem(
        given.diffusion, CALL, given.expiry, interval=(None, level), ends=("exponential", Held(0.0))
    )
    return Question(problem, given.x, value, 1e-13)


def elasticity(rng: np.random.Generator) -> Question:
    """Return a European put with sigma(S) = alpha S^(beta - 1) (Cox 1975)."""
    r, T = rng.uniform(0.01, 0.1), math.exp(rng.uniform(math.log(0.1), math.log(3.0)))
    alpha, beta = rng.uniform(0.15, 0.4), rng.uniform(0.3, 0.9)
    x = rng.uniform(-1.0, 1.0) * alpha * math.sqrt(T)
    power = 2.0 * (1.0 - beta)
    k = r / (alpha**2 * (1.0 - beta) * math.expm1(r * power * T))
    a, b, nu = k * math.exp(power * (x + r * T)), k, 1.0 / power
    call = math.exp(x) * ncx2.sf(2.0 * b, 2.0 + 2.0 * nu, 2.0 * a) - math.exp(-r * T) * ncx2.cdf(
        2.0 * a, 2.0 * nu, 2.0 * b
    )
    diffusion = Diffusion(
        lambda x: alpha * np.exp((beta - 1.0) * x), lambda x: r - alpha**2 / 2.0 * np.exp(-power * x), r
    )
    value = float(call - math.exp(x) + math.exp(-r * T))
    return Question(ObstacleProblem(diffusion, PUT, T, ends=PRICES), x, value, 1e-9)


def breaks(rng: np.random.Generator) -> Question:
    """Return a European option with a rate, a yield and a volatility that jump at a time."""
    first, second = terms(rng), terms(rng)
    T, share, call = first.expiry, rng.uniform(0.2, 0.8), bool(rng.random() < 0.5)
    middle = share * T
    early, late = (one.diffusion for one in (first, second))

    def at(name: str) -> Callable[[np.ndarray, float], float]:
        return lambda x, t: getattr(early if t < middle else late, name)

    def mean(name: str) -> float:
        return float(share * getattr(first, name) + (1.0 - share) * getattr(second, name))

    variance = share * first.volatility**2 + (1.0 - share) * second.volatility**2
    whole = Terms(mean("rate"), mean("dividend_yield"), math.sqrt(variance), T, first.x)
    diffusion = Diffusion(at("volatility"), at("drift"), at("rate"), breaks=[middle])
    problem = ObstacleProblem(diffusion, CALL if call else PUT, T, ends=PRICES)
    return Question(problem, first.x, whole.european(call=call), 0.0)


def vasicek(rng: np.random.Generator) -> Question:
    """Return a bond with a coupon half-way, over a short rate that reverts to its mean (Vasicek 1977)."""
    speed, mean, sigma = rng.uniform(0.1, 1.5), rng.uniform(-0.01, 0.08), rng.uniform(0.003, 0.03)
    T, x, coupon = rng.uniform(0.5, 8.0), rng.uniform(-0.02, 0.1), rng.uniform(0.0, 0.1)

    def bond(tau: float) -> float:
        B = -math.expm1(-speed * tau) / speed
        A = (mean - sigma**2 / (2.0 * speed**2)) * (B - tau) - sigma**2 * B**2 / (4.0 * speed)
        return math.exp(A - B * x)

    diffusion = Diffusion(sigma, lambda x: speed * (mean - x), lambda x: x)
    problem = ObstacleProblem(diffusion, Obstacle(1.0), T, events=[Event(T / 2.0, cash=coupon)])
    return Question(problem, x, bond(T) + coupon * bond(T / 2.0), 0.0)


def capped(rng: np.random.Generator) -> Question:
    """Return an American call that pays at most a cap."""
    given, cap = terms(rng), math.exp(rng.uniform(-2.5, -0.5))
    payoff = Obstacle(lambda x: np.clip(np.exp(x) - 1.0, 0.0, cap), kinks=[0.0, math.log1p(cap)])
    problem = ObstacleProblem(given.diffusion, payoff, given.expiry, lower=payoff, ends=PRICES)
    return _nodal(problem, given, math.log1p(cap))


def callable_(rng: np.random.Generator) -> Question:
    """Return an American put that its writer may call for its payoff and a penalty."""
    given, penalty = terms(rng), math.exp(rng.uniform(-4.5, -2.0))
    upper = Obstacle(lambda x: np.maximum(1.0 - np.exp(x), 0.0) + penalty, kinks=[0.0])
    problem = ObstacleProblem(given.diffusion, PUT, given.expiry, lower=PUT, upper=upper, ends=PRICES)
    return _nodal(problem, given, 0.0)


def _nodal(problem: ObstacleProblem, given: Terms, kink: float) -> Question:
    """Return the question whose value three nodal problems tell, with the kink and the place on nodes."""
    deviation = given.volatility * math.sqrt(given.expiry)
    far = max(abs(given.x - kink), 0.25 * deviation)
    h = far / max(1, round(far / (12.0 * deviation / NODAL_CELLS)))
    x = given.x if abs(given.x - kink) >= 0.25 * deviation else kink + math.copysign(far, given.x - kink)
    low = kink - h * math.ceil((kink - min(x, kink) + 5.5 * deviation) / h)
    cells = math.ceil((max(x, kink) + 5.5 * deviation - low) / h)
    found = []
    for finer in (1, 2, 4):
        count = cells * finer - 1
        method, state, nodes = nodal_method(problem, count, (low, low + cells * h), tableau=SDIRK2)
        run = integrate(method, state, (0.0, given.expiry), controller=FixedStep(given.expiry / (64 * finer)))
        found.append(float(np.interp(x, nodes, run.states[-1].value)))
    coarse, value = (fine + (fine - before) / 3.0 for before, fine in pairwise(found))
    return Question(problem, x, value, abs(found[2] - found[1]) / 3.0 + abs(value - coarse))


FAMILIES: dict[str, tuple[Callable[[np.random.Generator], Question], float]] = {  # and their shares
    "European": (european, 0.16),
    "American": (american, 0.22),
    "American, cash dividends": (with_dividends, 0.16),
    "Bermudan": (bermudan, 0.1),
    "up-and-out": (barrier, 0.1),
    "constant elasticity": (elasticity, 0.08),
    "coefficients that jump": (breaks, 0.06),
    "Vasicek's bond": (vasicek, 0.06),
    "capped call": (capped, 0.03),
    "callable put": (callable_, 0.03),
}


class Family(NamedTuple):
    """What was found of one family."""

    family: str
    problems: int
    within_estimate: float
    worst_error_in_estimates: float
    median_estimate_in_errors: float
    met_tolerance: float
    median_ms: float


def study(problems: int, seed: int = 1) -> list[Family]:
    """Solve random problems of all families."""
    found = []
    for place, (name, (make, share)) in enumerate(FAMILIES.items()):
        rng = np.random.default_rng([seed, place])
        rows = []
        for _ in range(max(1, round(share * problems))):
            question, tolerance = make(rng), 10.0 ** rng.uniform(-6.0, -4.0)
            begun = process_time()
            solution = solve(question.problem, question.x, tolerance)
            taken = process_time() - begun
            error = max(abs(solution.value - question.value) - question.uncertain, 0.0)
            rows.append((error, solution.error_estimate, solution.status == "ok", taken))
        error, estimate, ok, seconds = (np.array(column, dtype=float) for column in zip(*rows, strict=True))
        seen = error > 1e-10  # where the true value is known well enough to see an error at all
        ratio = estimate[seen] / error[seen]
        found.append(
            Family(
                name,
                len(rows),
                float(np.mean(error <= estimate)),
                float((error / estimate).max()),
                float(np.median(ratio)) if seen.any() else math.nan,
                float(ok.mean()),
                1e3 * float(np.median(seconds)),
            )
        )
    return found


def main() -> None:
    """Print the table, and the shares of all together."""
    found = study(60 if "--quick" in sys.argv else 2_000)
    print(table("families", found))
    count = sum(family.problems for family in found)
    within = sum(family.within_estimate * family.problems for family in found) / count
    print(f"\n{count} problems: {100 * within:.2f} % of the errors within their estimates")


if __name__ == "__main__":
    main()
