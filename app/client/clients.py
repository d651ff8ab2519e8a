"""The two clients, one that blocks and one for asyncio: each sends the requests of an exchange."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar, overload
from urllib.parse import urlencode

import httpx
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from app.client import answers
from app.client.chain import ChainAnswer, chain_answer, chain_question
from app.client.exchange import Exchange, Question, exchange
from app.client.questions import contract_question, contracts_table, table_question
from pricing_core.american import (
    ExerciseAdvice,
    ExerciseBoundary,
    ImpliedVolatility,
    Market,
    Option,
    Valuation,
    ValueSurface,
)
from pricing_core.american.arrow.frames import (
    AnyFrame,
    contracts_of,
    known_frame,
    schema_of_results,
    with_results,
)
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.surface import SurfaceGreeks
from pricing_core.arrays import as_vector

ATTEMPTS = 5
TIMEOUT = 75.0  # seconds for one attempt: more than the deadline of a batch
Answer = TypeVar("Answer")
Reader = Callable[[httpx.Response], Answer]


def _headers(api_key: str | None) -> dict[str, str]:
    return {} if api_key is None else {"Authorization": f"Bearer {api_key}"}


def _sent(question: Question) -> dict[str, Any]:
    """Return what httpx is told of a question."""
    headers = {"Content-Type": question.media_type, "Accept": question.accepted}
    return {"url": question.path, "content": question.body, "headers": headers}


def _price(option: Option, market: Market, tolerance: float, greeks: Greeks) -> Question:
    return contract_question(
        "v1/price", option, market, tolerance=tolerance, greeks=greeks, greek_errors=True
    )


def _at_times(
    path: str, option: Option, market: Market, times: ArrayLike | None, tolerance: float
) -> Question:
    chosen = None if times is None else as_vector("times", times).tolist()
    return contract_question(path, option, market, times=chosen, tolerance=tolerance)


def _implied(
    option: Option,
    market: Market,
    option_price: float | None,
    bid: float | None,
    ask: float | None,
    tolerance: float,
) -> Question:
    quotes = {"option_price": option_price, "bid": bid, "ask": ask}
    return contract_question(
        "v1/implied-volatility", option, market, "volatility", **quotes, tolerance=tolerance
    )


def _surface(
    option: Option,
    market: Market,
    spots: ArrayLike,
    times: ArrayLike,
    tolerance: float,
    greeks: SurfaceGreeks,
) -> Question:
    chosen = {"spots": as_vector("spots", spots).tolist(), "times": as_vector("times", times).tolist()}
    return contract_question(
        "v1/surface", option, market, "spot", **chosen, tolerance=tolerance, greeks=greeks
    )


def _batch(
    contracts: pa.Table, tolerance: float, greeks: Greeks, *, greek_errors: bool, advice: bool
) -> Question:
    settings = {"tolerance": repr(tolerance), "greeks": greeks}
    settings |= {"greek_errors": str(greek_errors).lower(), "advice": str(advice).lower()}
    return table_question(f"v1/batch?{urlencode(settings)}", contracts)


def _many(columns: Any, greeks: Greeks, *, greek_errors: bool, advice: bool) -> tuple[pa.Table, Reader[Any]]:
    """Return the contracts of columns or of a frame, and what makes an answer of their kind of the service's."""
    if isinstance(columns, Mapping):
        contracts = contracts_of(contracts_table(columns))
        return contracts, lambda answer: answers.as_columns(answers.results_table(answer, contracts.num_rows))
    frame = known_frame(columns)
    contracts = contracts_of(frame)
    schema_of_results(
        frame, greeks, greek_errors=greek_errors, advice=advice
    )  # before the work is done elsewhere
    return contracts, lambda answer: with_results(frame, answers.results_table(answer, contracts.num_rows))


class Client:
    """A client of the service; its methods are the functions of the library with their arguments and results.

    Parameters
    ----------
    url : str
        Address of the service, such as "http://127.0.0.1:8000".
    api_key : str, optional
        Where the service wants one.
    attempts : int
        How often a question is asked where the service is away, busy or breaks off; it is left alone in between for as
        long as it says in Retry-After, and else for 0.25 s, 0.5 s, 1 s, ...
    timeout : float
        Seconds for one attempt.

    Examples
    --------
    >>> with Client("http://127.0.0.1:8000") as client:  # doctest: +SKIP
    ...     client.price(Option("put", 100.0, 1.0), Market(100.0, rate=0.05, volatility=0.2)).price
    6.0903...
    """

    def __init__(
        self, url: str, api_key: str | None = None, *, attempts: int = ATTEMPTS, timeout: float = TIMEOUT
    ) -> None:
        self._attempts = attempts
        self._http = httpx.Client(base_url=url, headers=_headers(api_key), timeout=timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def price(
        self,
        option: Option,
        market: Market,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: Greeks = "standard",
    ) -> Valuation:
        """Value one option, as `pricing_core.american.price` does; the diagnostics of the result are empty.

        Parameters
        ----------
        option : Option
        market : Market
        tolerance : float
            Absolute error of the price that is asked for, in units of the strike.
        greeks : {"none", "standard", "extended"}
            Which Greeks are found.

        Raises
        ------
        InvalidInputError, NumericalError
            For the same reasons as in `pricing_core.american.price`.
        ServiceUnavailableError, ServiceRefusedError, BrokenAnswerError
            The service did not answer.
        """
        return self._ask(_price(option, market, tolerance, greeks), answers.valuation)

    def boundary(
        self,
        option: Option,
        market: Market,
        times: ArrayLike | None = None,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ExerciseBoundary:
        """Find the exercise boundary, as `pricing_core.american.exercise_boundary` does.

        Parameters
        ----------
        option : Option
        market : Market
            Its spot is not used.
        times : array_like, shape (m,), optional
            Years from now; the service chooses them where they are missing.
        tolerance : float
            The same as that of the function.

        Raises
        ------
        PricingCoreError
            For the same reasons as in `price`.
        """
        return self._ask(
            _at_times("v1/boundary", option, market, times, tolerance), answers.exercise_boundary
        )

    def exercise_advice(
        self,
        option: Option,
        market: Market,
        times: ArrayLike | None = None,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ExerciseAdvice:
        """Say whether and when to exercise, as `pricing_core.american.exercise_advice` does.

        Parameters
        ----------
        option : Option
        market : Market
        times : array_like, shape (m,), optional
            Years from now at which the distribution is given.
        tolerance : float
            The same as that of the function.

        Raises
        ------
        PricingCoreError
            For the same reasons as in `price`.
        """
        return self._ask(
            _at_times("v1/exercise-advice", option, market, times, tolerance), answers.exercise_advice
        )

    def implied_volatility(
        self,
        option: Option,
        market: Market,
        option_price: float | None = None,
        *,
        bid: float | None = None,
        ask: float | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ImpliedVolatility:
        """Find the volatility that a price implies, as `pricing_core.american.implied_volatility` does.

        Parameters
        ----------
        option : Option
        market : Market
            Its volatility is not used.
        option_price : float, optional
            Money. It is given alone, or `bid` and `ask` are given in its place.
        bid, ask : float, optional
            Money.
        tolerance : float
            The same as that of the function.

        Raises
        ------
        PricingCoreError
            For the same reasons as in `price`.
        """
        question = _implied(option, market, option_price, bid, ask, tolerance)
        return self._ask(question, answers.implied_volatility)

    def surface(
        self,
        option: Option,
        market: Market,
        *,
        spots: ArrayLike,
        times: ArrayLike,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: SurfaceGreeks = "standard",
    ) -> ValueSurface:
        """Value the option at every pair of a time and a spot, as `pricing_core.american.value_surface` does.

        Parameters
        ----------
        option : Option
        market : Market
            Its spot is not used.
        spots : array_like, shape (n,)
            Money.
        times : array_like, shape (m,)
            Years from now.
        tolerance : float
            The same as that of the function.
        greeks : {"none", "standard"}
            Whether delta, gamma, theta and vega come with the values.

        Raises
        ------
        PricingCoreError
            For the same reasons as in `price`.
        """
        return self._ask(_surface(option, market, spots, times, tolerance, greeks), answers.value_surface)

    @overload
    def price_many(
        self,
        columns: Mapping[str, Any],
        *,
        tolerance: float = ...,
        greeks: Greeks = ...,
        greek_errors: bool = ...,
        advice: bool = ...,
    ) -> dict[str, NDArray[Any]]: ...

    @overload
    def price_many(
        self,
        columns: AnyFrame,
        *,
        tolerance: float = ...,
        greeks: Greeks = ...,
        greek_errors: bool = ...,
        advice: bool = ...,
    ) -> AnyFrame: ...

    def price_many(
        self,
        columns: Any,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: Greeks = "standard",
        greek_errors: bool = False,
        advice: bool = False,
    ) -> Any:
        """Price one option per row by way of an Arrow stream, as `pricing_core.american.price_many` does.

        Parameters
        ----------
        columns : mapping of str to array_like or scalar, or a frame
            A mapping is answered with arrays, a frame of Arrow, pandas or polars with itself and the results as
            further columns; columns that state nothing of the contracts are not sent.
        tolerance : float
            Absolute error of a price that is asked for, in units of its strike.
        greeks : {"none", "standard", "extended"}
            Which Greeks are found.
        greek_errors : bool
            Whether each Greek is followed by the column of its estimated error.
        advice : bool
            Whether the columns of the exercise advice are added.

        Raises
        ------
        InvalidInputError
            Columns have different lengths, or one is missing or unknown.
        """
        contracts, read = _many(columns, greeks, greek_errors=greek_errors, advice=advice)
        return self._ask(_batch(contracts, tolerance, greeks, greek_errors=greek_errors, advice=advice), read)

    def chain(
        self,
        quotes: Any,
        rate: Any,
        *,
        cash_dividends: Sequence[Any] = (),
        valuation_date: object = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ChainAnswer:
        """Fit the quotes of one underlying, as `pricing_core.chains.fit_chain` does.

        Parameters
        ----------
        quotes : object
            A table that `read_chain` has returned, or anything that it reads.
        rate : float or curve
            The risk-free rate, 1/year, continuously compounded.
        cash_dividends : sequence
            Cash dividends until the last expiry, as `fit_chain` takes them.
        valuation_date : date or str, optional
            The day of the quotes, where they do not state it.
        tolerance : float
            The same as that of the function.

        Raises
        ------
        PricingCoreError
            For the same reasons as in `price`.
        """
        question = chain_question(quotes, rate, cash_dividends, valuation_date, tolerance)
        return self._ask(question, chain_answer)

    def _ask(self, question: Question, read: Reader[Answer]) -> Answer:
        return read(self._follow(exchange(question, self._attempts)))

    def _follow(self, steps: Exchange) -> httpx.Response:
        step = next(steps)
        try:
            while True:
                step = steps.send(self._take(step))
        except StopIteration as end:
            response: httpx.Response = end.value
            return response

    def _take(self, step: Question | float) -> httpx.Response | httpx.TransportError | None:
        if isinstance(step, float):
            time.sleep(step)
            return None
        try:
            return self._http.post(**_sent(step))
        except httpx.TransportError as error:
            return error


class AsyncClient:
    """A client of the service for asyncio: every method of `Client`, to be awaited; its connections end with `aclose`.

    Parameters
    ----------
    url, api_key, attempts, timeout
        The same as those of `Client`.
    """

    def __init__(
        self, url: str, api_key: str | None = None, *, attempts: int = ATTEMPTS, timeout: float = TIMEOUT
    ) -> None:
        self._attempts = attempts
        self._http = httpx.AsyncClient(base_url=url, headers=_headers(api_key), timeout=timeout)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def price(
        self,
        option: Option,
        market: Market,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: Greeks = "standard",
    ) -> Valuation:
        """Value one `option` in a `market` as `Client.price` does, with the same `tolerance` and `greeks`."""
        return await self._ask(_price(option, market, tolerance, greeks), answers.valuation)

    async def boundary(
        self,
        option: Option,
        market: Market,
        times: ArrayLike | None = None,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ExerciseBoundary:
        """Find the exercise boundary as `Client.boundary` does.

        The arguments `option`, `market`, `times` and `tolerance` are the same.
        """
        return await self._ask(
            _at_times("v1/boundary", option, market, times, tolerance), answers.exercise_boundary
        )

    async def exercise_advice(
        self,
        option: Option,
        market: Market,
        times: ArrayLike | None = None,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ExerciseAdvice:
        """Say whether and when to exercise as `Client.exercise_advice` does.

        The arguments `option`, `market`, `times` and `tolerance` are the same.
        """
        return await self._ask(
            _at_times("v1/exercise-advice", option, market, times, tolerance), answers.exercise_advice
        )

    async def implied_volatility(
        self,
        option: Option,
        market: Market,
        option_price: float | None = None,
        *,
        bid: float | None = None,
        ask: float | None = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ImpliedVolatility:
        """Find the volatility that a price implies as `Client.implied_volatility` does.

        The arguments are the same: `option`, `market`, `option_price` or `bid` and `ask`, and `tolerance`.
        """
        question = _implied(option, market, option_price, bid, ask, tolerance)
        return await self._ask(question, answers.implied_volatility)

    async def surface(
        self,
        option: Option,
        market: Market,
        *,
        spots: ArrayLike,
        times: ArrayLike,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: SurfaceGreeks = "standard",
    ) -> ValueSurface:
        """Value an `option` in a `market` at every pair of `times` and `spots` as `Client.surface` does.

        The `tolerance` and `greeks` are the same.
        """
        question = _surface(option, market, spots, times, tolerance, greeks)
        return await self._ask(question, answers.value_surface)

    async def price_many(
        self,
        columns: Any,
        *,
        tolerance: float = DEFAULT_TOLERANCE,
        greeks: Greeks = "standard",
        greek_errors: bool = False,
        advice: bool = False,
    ) -> Any:
        """Price one option per row of `columns` as `Client.price_many` does.

        The arguments `tolerance`, `greeks`, `greek_errors` and `advice` are the same.
        """
        contracts, read = _many(columns, greeks, greek_errors=greek_errors, advice=advice)
        return await self._ask(
            _batch(contracts, tolerance, greeks, greek_errors=greek_errors, advice=advice), read
        )

    async def chain(
        self,
        quotes: Any,
        rate: Any,
        *,
        cash_dividends: Sequence[Any] = (),
        valuation_date: object = None,
        tolerance: float = DEFAULT_TOLERANCE,
    ) -> ChainAnswer:
        """Fit the `quotes` of one underlying at a `rate` as `Client.chain` does.

        The arguments `cash_dividends`, `valuation_date` and `tolerance` are the same.
        """
        question = chain_question(quotes, rate, cash_dividends, valuation_date, tolerance)
        return await self._ask(question, chain_answer)

    async def _ask(self, question: Question, read: Reader[Answer]) -> Answer:
        return read(await self._follow(exchange(question, self._attempts)))

    async def _follow(self, steps: Exchange) -> httpx.Response:
        step = next(steps)
        try:
            while True:
                step = steps.send(await self._take(step))
        except StopIteration as end:
            response: httpx.Response = end.value
            return response

    async def _take(self, step: Question | float) -> httpx.Response | httpx.TransportError | None:
        if isinstance(step, float):
            await asyncio.sleep(step)
            return None
        try:
            return await self._http.post(**_sent(step))
        except httpx.TransportError as error:
            return error
