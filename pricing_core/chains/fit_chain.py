"""From a table of American quotes to carry, volatilities, a surface and a local volatility."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, TOLERANCE
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.vocabulary import contract_from
from pricing_core.american.implied.carry_pairs import Chain
from pricing_core.american.implied.carry_pairs import read_chain as read_pairs
from pricing_core.american.implied.implied_carry import discount
from pricing_core.american.price_book import checked_threads
from pricing_core.arrays import BoolVector
from pricing_core.chains.agreement import Agreement
from pricing_core.chains.canonical import MESSAGE
from pricing_core.chains.carry import Carry
from pricing_core.chains.chain_fit import ChainFit, carry_table, dividends_table, pairs_table, quotes_table
from pricing_core.chains.cleaning import Flags, as_words, counts, flag_quotes, usable
from pricing_core.chains.fit_carry import fit_carry
from pricing_core.chains.forward_volatilities import of_forward
from pricing_core.chains.implied_dividends import (
    NONE_IMPLIED,
    filled,
    imply_dividends,
    is_implied,
    with_dividends,
)
from pricing_core.chains.quotes import Quotes, read_quotes
from pricing_core.chains.read_chain import read_chain
from pricing_core.chains.smiles import american_quotes, smiles_of
from pricing_core.chains.surface.smile_quotes import SmileQuotes
from pricing_core.chains.surfaces import Fitted, fit_surfaces, without_surface
from pricing_core.chains.volatilities import QuoteVolatilities, quote_volatilities, reconcile
from pricing_core.errors import MissingInputError

ANY_VOLATILITY = 0.2  # of a market whose volatility is what is looked for


def fit_chain(
    quotes: Any,
    rate: Any = None,
    *,
    cash_dividends: Sequence[Any] = (),
    proportional_dividends: Sequence[Any] = (),
    valuation_date: object = None,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> ChainFit:
    """Fit the quotes of one underlying at one moment.

    Quotes with a flag of `FLAGS` take no part in the fits, but for those that are only told. The carry is the yield
    curve at which call and put of a strike agree (`fit_carry`); bid, mid and ask lose their early exercise premium at
    one volatility for all spots; call and put of a strike are reconciled by their spreads; a surface without arbitrage
    is fitted to what is left (`fit_surface`). Under its local volatility the premiums of the pairs are found again, and
    the carry and all volatilities with them. The local volatility of Dupire is then corrected until American prices
    under it meet the quotes (`correct`).

    Parameters
    ----------
    quotes : pyarrow.Table
        As `read_chain` returns it; anything else is read by it first.
    rate : float or curve
        Risk-free, 1/year, continuously compounded.
    cash_dividends, proportional_dividends : sequence
        Those that are known: `CashDividend`, `ProportionalDividend`, or mappings with "ex_date" or "time" and "amount"
        or "fraction". A cash dividend without an amount, or of None, has the one that the quotes imply, if nothing but
        dividends is paid (`imply_dividends`); what they do not explain is part of the yield.
    valuation_date : str, date or datetime, optional
        Local time of the market; the quotes' own by default. Without a time of day expiries are whole days / 365.
    tolerance : float
        Tolerance of American prices, as a fraction of the strike.
    threads : int, optional
        How many to use, >= 1; one by default.
    interrupt : callable, optional
        Asked between steps of the work; True ends it with NumericalError.

    Returns
    -------
    ChainFit

    Raises
    ------
    InvalidInputError
        The quotes are none, are of several underlyings, currencies or exercise styles, or an argument is outside what
        is allowed. What is wrong with single rows or expiries is a flag or a status.
    NumericalError
        The interrupt came.
    """
    tolerance, _ = TOLERANCE.check(tolerance), checked_threads(threads)
    if rate is None:
        raise MissingInputError({"rate": "1/year"}, "give a number or a curve")
    read = read_quotes(_canonical(quotes), valuation_date)
    market = _market(read, rate, filled(cash_dividends), proportional_dividends)
    flags = flag_quotes(read)
    good = usable(flags)
    settings: dict[str, Any] = {"tolerance": tolerance, "threads": threads, "interrupt": interrupt}
    implied = NONE_IMPLIED
    if any(is_implied(each) for each in cash_dividends):
        wanted = _market(read, rate, filled([each for each in cash_dividends if is_implied(each)]), ())
        given = [each for each in cash_dividends if not is_implied(each)]
        market = _market(read, rate, given, proportional_dividends)
        times = np.unique([each.time for each in wanted.cash_dividends])
        implied = imply_dividends(market, times, lambda one: fit_carry(_pairs(read, one, good), **settings))
        market = with_dividends(market, implied.time, implied.amount)
    pairs = _pairs(read, market, good)
    carry = fit_carry(pairs, **settings)
    flags["no_carry"] = np.full(good.size, not carry.is_known) & good
    fitted = without_surface(good.size, "surface: no pair of call and put tells the carry")
    if carry.is_known:
        agreement = Agreement(pairs, carry, market, american_quotes(read, good))
        # The other quotes, whose premiums are large, are of use once these are known.
        rows = _out_of_the_money(read, carry) if read.exercise == "american" else good
        smiles = _volatilities(read, market, rows & _priceable(read, flags), good, carry, settings).smiles
        start = replace(market, dividend_yield=carry.curve)
        fitted = fit_surfaces(smiles, start, agreement.quotes, read.exercise, agreement, interrupt)
        carry = agreement.carry
    stage = _volatilities(read, market, _priceable(read, flags), good, carry, settings)
    market = replace(market, dividend_yield=carry.curve)
    flags["put_call_mismatch"] = stage.mismatch
    table = quotes_table(read, stage.found, fitted, as_words(flags))
    return _fit(read, market, flags, carry, fitted, stage, table, dividends_table(market, implied))


class _Stage(NamedTuple):
    """The volatilities of the quotes at one carry."""

    found: QuoteVolatilities
    smiles: list[SmileQuotes]
    mismatch: BoolVector


def _volatilities(
    quotes: Quotes,
    market: Market,
    priceable: BoolVector,
    good: BoolVector,
    carry: Carry,
    settings: dict[str, Any],
) -> _Stage:
    place = _places(quotes, carry)
    yields = carry.dividend_yield[place] if carry.expiry.size else np.zeros(good.size)
    found = quote_volatilities(quotes, priceable, market, yields, **settings)
    smile = found
    if market.cash_dividends and carry.expiry.size:
        due = np.array([discount(market.rate, expiry) for expiry in carry.expiry.tolist()])
        smile = of_forward(quotes, found, carry.forward[place], due[place])
    strikes, mismatch = reconcile(quotes, smile, good)
    return _Stage(found, smiles_of(strikes, carry), mismatch)


def _places(quotes: Quotes, carry: Carry) -> NDArray[np.intp]:
    """Return the index of each row's expiry."""
    return np.minimum(np.searchsorted(carry.expiry, quotes.expiry), max(carry.expiry.size - 1, 0))


def _out_of_the_money(quotes: Quotes, carry: Carry) -> BoolVector:
    found: BoolVector = quotes.is_call == (quotes.strike >= carry.forward[_places(quotes, carry)])
    return found


def _fit(
    quotes: Quotes,
    market: Market,
    flags: Flags,
    carry: Carry,
    fitted: Fitted,
    stage: _Stage,
    table: pa.Table,
    dividends: pa.Table,
) -> ChainFit:
    if fitted.local_volatility is not None:
        market = replace(market, volatility=fitted.local_volatility)
    return ChainFit(
        quotes=table,
        carry=carry_table(quotes, carry),
        pairs=pairs_table(carry),
        dividends=dividends,
        flags=counts(flags),
        market=market,
        valuation=quotes.valuation,
        smiles=tuple(stage.smiles),
        surface=fitted.surface,
        local_volatility=fitted.local_volatility,
        share_within_before=fitted.share_within_before,
        share_within_after=fitted.share_within_after,
        surface_message=fitted.message,
    )


def _canonical(quotes: Any) -> pa.Table:
    if (
        isinstance(quotes, pa.Table)
        and MESSAGE in quotes.schema.names
        and "contract_multiplier" in quotes.schema.names
    ):
        return quotes
    return read_chain(quotes)


def _market(quotes: Quotes, rate: Curve, cash: Sequence[Any], proportional: Sequence[Any]) -> Market:
    """Return the market as it is given, dividends by their times."""
    contract = {
        "option_type": "call",
        "strike": quotes.spot,
        "valuation_date": quotes.valuation,
        "expiration_date": quotes.valuation + dt.timedelta(days=1),
        "spot": quotes.spot,
        "rate": rate,
        "volatility": ANY_VOLATILITY,
        "cash_dividends": cash,
        "proportional_dividends": proportional,
    }
    return contract_from(contract)[1]


def _pairs(quotes: Quotes, market: Market, good: BoolVector) -> Chain:
    """Return the calls and puts that tell the carry, and all expiries that live."""
    live = quotes.readable & (quotes.expiry > 0.0)
    chain = {
        "option_type": quotes.option_type[live],
        "strike": quotes.strike[live],
        "expiry": quotes.expiry[live],
        "bid": np.where(good, quotes.bid, np.nan)[live],
        "ask": np.where(good, quotes.ask, np.nan)[live],
        "spot": quotes.spot,
        "rate": market.rate,
        "exercise": quotes.exercise,
        "cash_dividends": market.cash_dividends,
        "proportional_dividends": market.proportional_dividends,
    }
    return read_pairs(chain)


def _priceable(quotes: Quotes, flags: Flags) -> BoolVector:
    """Return which rows have a bid, which may be 0, and an ask that is not below it, of an option that lives."""
    out = flags["unreadable"] | flags["expired"] | flags["crossed"] | flags["stale"]
    with np.errstate(invalid="ignore"):
        sound: BoolVector = ~out & (quotes.ask > 0.0) & (quotes.expiry > 0.0)
    return sound
