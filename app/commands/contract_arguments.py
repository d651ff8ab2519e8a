"""The options of the command line that describe a contract, and the flat contract they make.

Heavy imports wait inside the functions, so that help and errors are quick.
"""

import inspect
from collections.abc import Callable
from copy import copy
from functools import wraps
from typing import Annotated, Any, TypeAlias, get_args, get_type_hints

import typer

Contract: TypeAlias = dict[str, Any]  # by the names of the vocabulary
DATE_HELP = "ISO date or date-time; both dates in the place of --expiry"


def number(text: str | float) -> float:
    """Read a number by the rules of the tables of a batch, in which 1_0 is not one."""
    from pricing_core.errors import InvalidInputError  # noqa: PLC0415
    from pricing_core.plain_number import read_number  # noqa: PLC0415

    try:
        return read_number("", text)
    except InvalidInputError as fault:
        raise typer.BadParameter(f"{fault.value!r} must be {fault.allowed}") from None


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers with commas between them."""
    return tuple(number(part.strip()) for part in text.split(","))


def names(text: str) -> tuple[str, ...]:
    """Read names with commas between them."""
    return tuple(part.strip() for part in text.split(","))


def number_or_curve(text: str | float) -> float | str:
    """Read a number; the JSON of a curve stays for the contract to read."""
    return text if isinstance(text, str) and text.lstrip().startswith("{") else number(text)


def number_or_date(text: str | float) -> float | str:
    """Read a number; a date stays for the contract to read."""
    from pricing_core.american.contracts.dates import is_meant_as_date  # noqa: PLC0415

    return text if isinstance(text, str) and is_meant_as_date(text) else number(text)


def dividend(text: str) -> tuple[str, float]:
    """Read TIME:NUMBER; the time may be an ISO date, which holds colons itself."""
    from pricing_core.american.contracts.dates import IN_WORDS, is_meant_as_date  # noqa: PLC0415
    from pricing_core.plain_number import PLAIN_NUMBER  # noqa: PLC0415

    time, colon, amount = (part.strip() for part in text.rpartition(":"))
    if not colon:
        raise typer.BadParameter(f"{text!r} must be TIME:AMOUNT or TIME:FRACTION, such as 0.25:1.5")
    if not (PLAIN_NUMBER.fullmatch(time) or is_meant_as_date(time)):
        raise typer.BadParameter(f"{text!r}: the time {time!r} must be a number of years, or {IN_WORDS}")
    try:
        return time, number(amount)
    except typer.BadParameter as fault:
        raise typer.BadParameter(f"{text!r}: behind the time, {fault.message}") from None


def _number_option(name: str, words: str) -> Any:
    return typer.Option(name, parser=number, metavar="FLOAT", help=words)


def _curve_option(name: str, words: str) -> Any:
    words += ', or {"times": [...], "values": [...]}'
    if name == "--volatility":
        words += ', or a local volatility {"times": [...], "spots": [...], "values": [[...], ...]}'
    return typer.Option(name, parser=number_or_curve, metavar="FLOAT|JSON", help=words)


def _time_option(name: str, words: str) -> Any:
    words += "; in years, or an ISO date where there are dates"
    return typer.Option(name, parser=number_or_date, metavar="FLOAT|DATE", help=words)


def _dividend_option(name: str, metavar: str, words: str) -> Any:
    words += " TIME is in years, or an ISO date where there are dates; may be repeated"
    return typer.Option(name, parser=dividend, metavar=metavar, help=words)


def contract_of(
    option_type: Annotated[str, typer.Option("--option-type", help="put or call")],
    strike: Annotated[float, _number_option("--strike", "money per unit of underlying")],
    rate: Annotated[Any, _curve_option("--rate", "1/year, continuously compounded")],
    spot: Annotated[float | None, _number_option("--spot", "money per unit of underlying")] = None,
    volatility: Annotated[Any, _curve_option("--volatility", "1/sqrt(year)")] = None,
    expiry: Annotated[
        float | None,
        _number_option("--expiry", "time to expiry, years; required unless both dates are given"),
    ] = None,
    valuation_date: Annotated[str | None, typer.Option("--valuation-date", help=DATE_HELP)] = None,
    expiration_date: Annotated[str | None, typer.Option("--expiration-date", help=DATE_HELP)] = None,
    dividend_yield: Annotated[Any, _curve_option("--dividend-yield", "1/year, continuous")] = 0.0,
    cash_dividend: Annotated[
        list[Any] | None, _dividend_option("--cash-dividend", "TIME:AMOUNT", "money at its ex-time.")
    ] = None,
    proportional_dividend: Annotated[
        list[Any] | None,
        _dividend_option("--proportional-dividend", "TIME:FRACTION", "fraction of the spot at its ex-time."),
    ] = None,
    dividend_model: Annotated[str, typer.Option("--dividend-model", help="spot or escrowed")] = "spot",
    underlying: Annotated[
        str, typer.Option("--underlying", help="spot or future: whether the spot is a futures price")
    ] = "spot",
    borrow_rate: Annotated[Any, _curve_option("--borrow-rate", "1/year, adds to the yield")] = 0.0,
    foreign_rate: Annotated[
        Any, _curve_option("--foreign-rate", "quanto: 1/year, the rate of the underlying's currency")
    ] = None,
    quanto_covariance: Annotated[
        float, _number_option("--quanto-covariance", "1/year, of ln(spot) and ln(price of its currency)")
    ] = 0.0,
    settlement_lag: Annotated[
        float, _number_option("--settlement-lag", "days from exercise or expiry to payment")
    ] = 0.0,
    exercise: Annotated[str, typer.Option("--exercise", help="american, european or bermudan")] = "american",
    exercise_time: Annotated[
        list[Any] | None, _time_option("--exercise-time", "bermudan only; may be repeated")
    ] = None,
    exercise_start: Annotated[
        Any, _time_option("--exercise-start", "american only: no exercise before it")
    ] = 0.0,
) -> Contract:
    """Return the contract by the names of the vocabulary, without what is not given."""
    contract = {
        "option_type": option_type,
        "spot": spot,
        "strike": strike,
        "expiry": expiry,
        "valuation_date": valuation_date,
        "expiration_date": expiration_date,
        "rate": rate,
        "volatility": volatility,
        "dividend_yield": dividend_yield,
        "cash_dividends": _dividends(cash_dividend, "amount"),
        "proportional_dividends": _dividends(proportional_dividend, "fraction"),
        "dividend_model": dividend_model,
        "underlying": underlying,
        "borrow_rate": borrow_rate,
        "foreign_rate": foreign_rate,
        "quanto_covariance": quanto_covariance,
        "settlement_lag": settlement_lag,
        "exercise": exercise,
        "exercise_times": exercise_time or [],
        "exercise_start": exercise_start,
    }
    return {name: value for name, value in contract.items() if value is not None}


def takes_contract(
    *, required: tuple[str, ...] = (), hidden: tuple[str, ...] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of a contract; it is called with the contract in their place, first.

    Parameters
    ----------
    required : tuple of str
        Options that this command cannot do without, beside those that none can.
    hidden : tuple of str
        Options that it takes and does not use: its help leaves them out.
    """
    hints = get_type_hints(contract_of, include_extras=True)
    options = dict(inspect.signature(contract_of).parameters)
    for name in required:
        options[name] = options[name].replace(default=inspect.Parameter.empty)
    for name in hidden:
        kind, option = get_args(hints[name])
        option = copy(option)
        option.hidden = True
        hints[name] = Annotated[kind, option]
        options[name] = options[name].replace(annotation=hints[name])

    def give(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command).parameters.values())[1:]

        @wraps(command)
        def run(**given: Any) -> None:
            command(contract_of(**{name: given.pop(name) for name in options}), **given)

        parameters = [*options.values(), *own]
        keyword_only = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters]
        run.__signature__ = inspect.Signature(keyword_only)  # type: ignore[attr-defined]  # what Typer reads
        run.__annotations__ = hints | get_type_hints(command, include_extras=True)
        return run

    return give


def _dividends(given: list[tuple[str, float]] | None, what: str) -> list[dict[str, Any]]:
    """Return dividends as mappings: with a time where it is a number, else with an ex-date."""
    return [_timed(time) | {what: value} for time, value in given or []]


def _timed(text: str) -> dict[str, Any]:
    from pricing_core.plain_number import PLAIN_NUMBER  # noqa: PLC0415

    return {"time": float(text)} if PLAIN_NUMBER.fullmatch(text) else {"ex_date": text}
