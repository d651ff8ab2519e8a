"""The `pricing` command; heavy imports wait inside the commands, so that help and errors are quick."""

import io
import json
import sys
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from app.command_failures import (
    FAILED,
    SOME_REJECTED,
    interrupted_by_signals,
    one_line_errors,
    print_failure,
    standard_output,
    tell_in_json,
    tell_in_words,
    told_of,
)
from app.commands.contract_arguments import (
    Contract,
    names,
    number,
    number_or_curve,
    numbers,
    takes_contract,
)
from app.start_up import INTERRUPTED

app = typer.Typer(
    help="American options solved as linear complementarity systems, and the systems themselves.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)


ToleranceArgument = Annotated[
    float,
    typer.Option(
        "--tolerance",
        parser=number,
        metavar="FLOAT",
        help="absolute error of the price as a fraction of the strike",
    ),
]
GreeksArgument = Annotated[
    Any,  # The library says which words there are.
    typer.Option(
        "--greeks",
        parser=str,
        metavar="TEXT",
        help="none, standard or extended: also vanna, volga, charm and those by each value of a curve",
    ),
]
GreekErrorsArgument = Annotated[
    bool, typer.Option("--greek-errors", help="give the estimated error of each Greek with it")
]
JsonArgument = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CsvArgument = Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="write a CSV table")]
ShareSolvesArgument = Annotated[
    bool, typer.Option("--share-solves", help="one solve for rows that differ in spot and strike alone")
]
ThreadsArgument = Annotated[
    int | None, typer.Option("--threads", min=1, help="rows priced at a time; default: all processors")
]
InputFormatArgument = Annotated[
    str | None, typer.Option("--input-format", metavar="FORMAT", help="csv or parquet")
]
OutputFormatArgument = Annotated[
    str | None, typer.Option("--output-format", metavar="FORMAT", help="csv or parquet")
]
TimesArgument = Annotated[
    list[float] | None,
    typer.Option(
        "--time", parser=number, metavar="FLOAT", help="calendar time, years from now; may be repeated"
    ),
]
PlotArgument = Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="draw a picture")]


def main() -> None:
    """Run the command line: status 0 all done, 1 some rows rejected, 2 nothing done and one line says why."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a path may hold what no encoding has
    try:
        with standard_output():
            status = app(standalone_mode=False)
    except typer.Exit as error:  # nobody reads
        status = error.exit_code
    except OSError as error:  # of help and version, which are printed before there is a command
        print_failure(told_of(error))
        status = FAILED
    except Exception as error:
        # The parser's own errors know how to put themselves in one sentence.
        sentence = (
            error.format_message() if hasattr(error, "format_message") else f"unexpected error: {error!r}"
        )
        print_failure(sentence)
        status = FAILED
    sys.exit(status)


def _show_version(wanted: bool) -> None:
    if wanted:
        from pricing_core import __version__, kernel_name  # noqa: PLC0415

        typer.echo(f"pricing {__version__} (kernel: {kernel_name()})")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="print version and kernel"),
    ] = False,
) -> None:
    pass


@app.command("price")
@takes_contract(required=("spot", "volatility"))
def price_command(
    contract: Contract,
    tolerance: ToleranceArgument = 1e-6,
    greeks: GreeksArgument = "standard",
    greek_errors: GreekErrorsArgument = False,
    as_json: JsonArgument = False,
) -> None:
    """Value one option and its sensitivities."""
    with one_line_errors():
        from app.commands.tables import print_valuation, valuation_json  # noqa: PLC0415
        from pricing_core.american import contract_from, price  # noqa: PLC0415

        option, market = contract_from(contract)
        valuation = price(option, market, tolerance=tolerance, greeks=greeks)
        with standard_output():
            if as_json:
                print(valuation_json(valuation, greek_errors=greek_errors))
            else:
                print_valuation(valuation, greeks, greek_errors=greek_errors)
        if valuation.price is None:
            print_failure(f"there is no price: {valuation.status}")
            raise typer.Exit(FAILED)


@app.command("boundary")
@takes_contract(required=("volatility",))
def boundary_command(
    contract: Contract,
    tolerance: ToleranceArgument = 1e-6,
    time: TimesArgument = None,
    as_json: JsonArgument = False,
    csv: CsvArgument = None,
    plot: PlotArgument = None,
) -> None:
    """Find the spot at which to exercise, over the life of the option; --spot is checked, but not needed."""
    with one_line_errors():
        from app.commands.boundary_files import write_boundary_csv, write_boundary_plot  # noqa: PLC0415
        from app.commands.output_files import check_output_files  # noqa: PLC0415
        from app.commands.tables import boundary_json, print_boundary  # noqa: PLC0415
        from pricing_core.american import contract_from, exercise_boundary  # noqa: PLC0415

        option, market = contract_from({"spot": contract["strike"]} | contract)
        check_output_files(csv, plot)
        found = exercise_boundary(option, market, time or None, tolerance=tolerance)
        if csv is not None:
            write_boundary_csv(csv, found)
        drawable = not all(map(isnan, found.boundary.tolist()))
        if plot is not None and drawable:
            write_boundary_plot(plot, found, option, market)
        with standard_output():
            if as_json:
                print(boundary_json(found))
            elif csv is None and plot is None:
                print_boundary(found)
        if plot is not None and not drawable:
            print_failure(
                "there is no exercise boundary to draw: at none of these times is exercise best at any spot"
            )
            raise typer.Exit(FAILED)


@app.command("advice")
@takes_contract(required=("spot", "volatility"))
def advice_command(
    contract: Contract,
    tolerance: ToleranceArgument = 1e-6,
    time: TimesArgument = None,
    daily: Annotated[bool, typer.Option("--daily", help="tell of every day to the expiry")] = False,
    as_json: JsonArgument = False,
    plot: PlotArgument = None,
) -> None:
    """Say whether to exercise, when the holder will have exercised, and what waiting costs."""
    with one_line_errors():
        from app.commands.output_files import check_output_files  # noqa: PLC0415
        from app.commands.tables import advice_json, print_advice  # noqa: PLC0415
        from pricing_core.american import contract_from, exercise_advice  # noqa: PLC0415
        from pricing_core.errors import InvalidInputError  # noqa: PLC0415

        option, market = contract_from(contract)
        check_output_files(None, plot)
        if daily and time:
            raise InvalidInputError("daily", True, "left out where times are given")
        advice = exercise_advice(option, market, "daily" if daily else time or None, tolerance=tolerance)
        if plot is not None:
            from app.commands.advice_plot import write_advice_plot  # noqa: PLC0415

            write_advice_plot(plot, advice, option, market)
        with standard_output():
            if as_json:
                print(advice_json(advice))
            elif plot is None:
                print_advice(advice)


@app.command("implied-volatility")
@takes_contract(required=("spot",), hidden=("volatility",))
def implied_volatility_command(
    contract: Contract,
    option_price: Annotated[
        float | None, typer.Option("--option-price", parser=number, metavar="FLOAT", help="money")
    ] = None,
    bid: Annotated[float | None, typer.Option("--bid", parser=number, metavar="FLOAT", help="money")] = None,
    ask: Annotated[float | None, typer.Option("--ask", parser=number, metavar="FLOAT", help="money")] = None,
    tolerance: ToleranceArgument = 1e-6,
    as_json: JsonArgument = False,
) -> None:
    """Find the volatility at which the option is worth its price, or its bid and ask."""
    with one_line_errors():
        from app.commands.tables import implied_volatility_json, print_implied_volatility  # noqa: PLC0415
        from pricing_core.american import contract_from, implied_volatility  # noqa: PLC0415

        option, market = contract_from({"volatility": 1.0} | contract)
        found = implied_volatility(option, market, option_price, bid=bid, ask=ask, tolerance=tolerance)
        with standard_output():
            if as_json:
                print(implied_volatility_json(found))
            elif found.volatility is not None:
                print_implied_volatility(found)
        if found.volatility is None:
            reason = f": {found.message}" if found.message else ""
            print_failure(f"there is no implied volatility: {found.status}{reason}")
            raise typer.Exit(FAILED)


@app.command("batch")
def batch_command(
    source: Annotated[
        str,
        typer.Argument(
            metavar="INPUT",
            help=".csv, .csv.gz, .csv.zst or .parquet, a folder of Parquet files, a URL, or - with --input-format",
        ),
    ],
    target: Annotated[
        str,
        typer.Argument(
            metavar="OUTPUT", help="likewise; a folder where INPUT is one; - with --output-format"
        ),
    ],
    tolerance: ToleranceArgument = 1e-6,
    greeks: GreeksArgument = "standard",
    greek_errors: GreekErrorsArgument = False,
    share_solves: ShareSolvesArgument = False,
    advice: Annotated[
        bool,
        typer.Option("--advice", help="add columns of advice on exercise; at most tenths of a second a row"),
    ] = False,
    threads: ThreadsArgument = None,
    rejects: Annotated[
        str | None,
        typer.Option("--rejects", metavar="FILE", help="default: OUTPUT.rejects.csv"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with what an ended run of the same work has left")
    ] = False,
    engine: Annotated[
        str, typer.Option("--engine", metavar="NAME", help="local: threads here; dask: worker processes")
    ] = "local",
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="of a Dask cluster; default: workers started here"
        ),
    ] = None,
    input_format: InputFormatArgument = None,
    output_format: OutputFormatArgument = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="no progress, no summary")] = False,
    log_json: Annotated[
        bool, typer.Option("--log-json", help="one JSON object per unit of work, on standard error")
    ] = False,
) -> None:
    """Price every row of a table; rows that cannot be priced are explained in the rejects file."""
    tell = tell_in_json if log_json else tell_in_words
    with one_line_errors(tell):
        from app.commands.batch_command import end_interrupted, price_table_of  # noqa: PLC0415

        try:
            with interrupted_by_signals():
                summary = price_table_of(
                    source,
                    target,
                    rejects,
                    tolerance=tolerance,
                    greeks=greeks,
                    greek_errors=greek_errors,
                    share_solves=share_solves,
                    advice=advice,
                    threads=threads,
                    engine=engine,
                    scheduler=scheduler,
                    resume=resume,
                    input_format=input_format,
                    output_format=output_format,
                    quiet=quiet,
                    log_json=log_json,
                )
        except KeyboardInterrupt as error:
            end_interrupted(error, tell, by_pipe="-" in (source, target))
        raise typer.Exit(SOME_REJECTED if summary.rejected and not summary.done_before else 0)


@app.command("scenarios")
def scenarios_command(
    source: Annotated[str, typer.Argument(metavar="INPUT", help="as of `pricing batch`")],
    target: Annotated[
        str, typer.Argument(metavar="OUTPUT", help="a file; - with --output-format for standard output")
    ],
    spot_shifts: Annotated[
        Any,
        typer.Option("--spot-shifts", parser=numbers, metavar="X,...", help="relative: -0.1 is 10 % down"),
    ] = None,
    volatility_shifts: Annotated[
        Any, typer.Option("--volatility-shifts", parser=numbers, metavar="X,...", help="0.01 is one point")
    ] = None,
    rate_shifts: Annotated[
        Any, typer.Option("--rate-shifts", parser=numbers, metavar="X,...", help="0.01 is one point")
    ] = None,
    days_forward: Annotated[
        Any, typer.Option("--days-forward", parser=numbers, metavar="X,...", help="days that pass")
    ] = None,
    scenarios: Annotated[
        str | None,
        typer.Option(
            "--scenarios", metavar="FILE", help="named combinations in the place of lists: CSV or JSON"
        ),
    ] = None,
    matrix: Annotated[
        bool, typer.Option("--matrix", help="a row per contract, a column of profits and losses per scenario")
    ] = False,
    group_by: Annotated[
        Any,
        typer.Option(
            "--group-by", parser=names, metavar="COLUMN,...", help="sums by the values of these columns"
        ),
    ] = None,
    tolerance: ToleranceArgument = 1e-6,
    greeks: Annotated[
        Any,
        typer.Option("--greeks", parser=str, metavar="TEXT", help="default: none; standard with --group-by"),
    ] = None,
    share_solves: ShareSolvesArgument = False,
    threads: ThreadsArgument = None,
    input_format: InputFormatArgument = None,
    output_format: OutputFormatArgument = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="no summary")] = False,
) -> None:
    """Value every contract of a table under every combination of shifts of its market, or after some days."""
    with one_line_errors(), interrupted_by_signals():
        from app.commands.scenario_commands import value_file  # noqa: PLC0415

        incomplete = value_file(
            source,
            target,
            scenarios,
            (spot_shifts, volatility_shifts, rate_shifts, days_forward),
            quiet=quiet,
            matrix=matrix,
            group_by=group_by or (),
            tolerance=tolerance,
            greeks=greeks or ("standard" if group_by else "none"),
            share_solves=share_solves,
            threads=threads,
            input_format=input_format,
            output_format=output_format,
        )
        raise typer.Exit(SOME_REJECTED if incomplete else 0)


@app.command("explain")
def explain_command(
    before: Annotated[str, typer.Argument(metavar="BEFORE", help="a table of contracts")],
    after: Annotated[
        str, typer.Argument(metavar="AFTER", help="the same contracts later, or in another market")
    ],
    target: Annotated[str, typer.Argument(metavar="OUTPUT", help="a file; - with --output-format")],
    key: Annotated[
        Any, typer.Option("--key", parser=names, metavar="COLUMN,...", help="what tells contracts apart")
    ] = "id",
    tolerance: ToleranceArgument = 1e-6,
    threads: ThreadsArgument = None,
    output_format: OutputFormatArgument = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="no summary")] = False,
) -> None:
    """Explain what contracts have gained or lost between two tables: by spot, volatility, time, rate and so on."""
    with one_line_errors(), interrupted_by_signals():
        from app.commands.scenario_commands import explain_files  # noqa: PLC0415

        incomplete = explain_files(
            before,
            after,
            target,
            quiet=quiet,
            key=key,
            tolerance=tolerance,
            threads=threads,
            output_format=output_format,
        )
        raise typer.Exit(SOME_REJECTED if incomplete else 0)


@app.command("chain")
def chain_command(
    source: Annotated[
        str, typer.Argument(metavar="INPUT", help="quotes of one underlying: .csv, .json or .parquet")
    ],
    folder: Annotated[Path, typer.Argument(metavar="OUTPUT_DIR", help="made where it is missing")],
    format_: Annotated[
        str,
        typer.Option(
            "--format",
            help="auto, generic, openbb, cboe, optionmetrics, orats, polygon, tradier, yfinance, thetadata, ibkr or "
            "optionsdx",
        ),
    ] = "auto",
    rate: Annotated[
        Any,
        typer.Option(
            "--rate",
            parser=number_or_curve,
            metavar="FLOAT|JSON",
            help='1/year, continuously compounded, or {"times": [...], "values": [...]}',
        ),
    ] = None,
    rates: Annotated[
        str | None,
        typer.Option(
            "--rates", metavar="FILE", help="zero rates: columns time or days, and rate; or a curve in JSON"
        ),
    ] = None,
    dividends: Annotated[
        str | None,
        typer.Option(
            "--dividends", metavar="FILE", help="cash dividends: columns ex_date or time, and amount"
        ),
    ] = None,
    valuation_date: Annotated[
        str | None,
        typer.Option(
            "--valuation-date", metavar="DATE", help="ISO date or local date-time; default: the quotes' own"
        ),
    ] = None,
    underlying_price: Annotated[
        float | None,
        typer.Option(
            "--underlying-price", parser=number, metavar="FLOAT", help="money, for files that lack it"
        ),
    ] = None,
    tolerance: ToleranceArgument = 1e-6,
    threads: ThreadsArgument = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="no summary")] = False,
) -> None:
    """Fit quotes: carry, volatilities, a surface without arbitrage, a local volatility; tables and a report."""
    with one_line_errors(), interrupted_by_signals():
        from app.commands.chain_command import fit_file  # noqa: PLC0415
        from pricing_core.batch.local_threads import threads_or_all  # noqa: PLC0415

        complete = fit_file(
            source,
            folder,
            format_=format_,
            rate=rate,
            rates=rates,
            dividends=dividends,
            valuation_date=valuation_date,
            underlying_price=underlying_price,
            tolerance=tolerance,
            threads=threads_or_all(threads),
            quiet=quiet,
        )
        raise typer.Exit(0 if complete else SOME_REJECTED)


@app.command("simulate")
def simulate_command(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="SYSTEM.json",
            help="a model file, of which --schema says what it holds, or a netlist: .cir, .net or .sp",
        ),
    ] = None,
    as_json: JsonArgument = False,
    csv: CsvArgument = None,
    plot: PlotArgument = None,
    animate: Annotated[
        Path | None,
        typer.Option(
            "--animate", metavar="FILE.gif", help="draw an animation of a mechanical system or a circuit"
        ),
    ] = None,
    schema: Annotated[bool, typer.Option("--schema", help="print the JSON Schema of model files")] = False,
) -> None:
    """Simulate a complementarity system: where it ends, and what happens on the way."""
    with one_line_errors():
        if schema:
            from app.commands.model_files import schema as schema_of_models  # noqa: PLC0415

            with standard_output():
                print(json.dumps(schema_of_models(), indent=1))
            return
        if source is None:
            from pricing_core.errors import MissingInputError  # noqa: PLC0415

            raise MissingInputError("SYSTEM.json", "give a model file, or --schema")
        from app.commands.model_files import simulate_file  # noqa: PLC0415
        from app.commands.output_files import check_output_files, write_columns  # noqa: PLC0415
        from app.commands.simulation_tables import print_simulation, simulation_columns, simulation_json  # noqa: PLC0415

        check_output_files(csv, plot, animate)
        simulation = simulate_file(source)
        if csv is not None:
            write_columns(csv, simulation_columns(simulation))
        if plot is not None:
            from app.commands.simulation_plots import draw_simulation  # noqa: PLC0415
            from pricing_core.replacement import replacement  # noqa: PLC0415

            with replacement(plot) as file:
                draw_simulation(simulation, file)
        if animate is not None:
            from app.commands.animation import animate_simulation  # noqa: PLC0415
            from pricing_core.replacement import replacement  # noqa: PLC0415

            with replacement(animate) as file:
                animate_simulation(simulation, file)
        with standard_output():
            if as_json:
                print(simulation_json(simulation))
            elif csv is None and plot is None and animate is None:
                print_simulation(simulation)


@app.command("benchmark")
def benchmark_command(
    output: Annotated[Path, typer.Option("--output", metavar="DIR", help="made where it is missing")],
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="engine-frontier, lcs-work-precision, max-plus, complementarity, cost-scaling, batch, "
            "cluster, service; default: all",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="about a minute, to see that it works; the figures mean little")
    ] = False,
) -> None:
    """Measure accuracy against time, beside other methods, and write reports: HTML, Markdown, JSON, PNG."""
    with one_line_errors():
        from app.commands.benchmark_command import check_names, run_benchmarks  # noqa: PLC0415

        chosen = check_names(names or [])
        try:
            with interrupted_by_signals():
                for written in run_benchmarks(chosen, output, quick=quick):
                    with standard_output():
                        print(f"{written.name}: {output / written.name}.html ({written.seconds:.0f} s)")
        except KeyboardInterrupt:
            print_failure("interrupted; the reports named so far are complete")
            raise typer.Exit(INTERRUPTED) from None


@app.command("key")
def key_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="whose key it is, as logs and limits have it")],
) -> None:
    """Print a new API key, and below it the line that lets it in: append that to PRICING_API_KEYS_FILE."""
    with one_line_errors():
        from app.service.api_keys import new_key  # noqa: PLC0415

        lines = new_key(name)
        with standard_output():
            print(*lines, sep="\n")


@app.command("serve")
def serve_command(
    host: Annotated[
        str | None,
        typer.Option("--host", help="0.0.0.0 is every address; default: PRICING_HOST, or 127.0.0.1"),
    ] = None,
    port: Annotated[
        int | None, typer.Option("--port", help="0 takes a free one; default: PRICING_PORT, or 8000")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", help="processes on that port; default: PRICING_WORKERS, or 1")
    ] = None,
) -> None:
    """Serve the HTTP interface until SIGTERM; its limits are PRICING_... environment variables, too."""
    with one_line_errors():
        from app.service.server import serve  # noqa: PLC0415
        from app.settings import settings_from_environment  # noqa: PLC0415

        serve(settings_from_environment(host=host, port=port, workers=workers))
