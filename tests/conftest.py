"""What concerns every test."""

from pricing_core import kernel_name


def pytest_terminal_summary(terminalreporter):
    """Say in the summary which tests were skipped for want of a compiled kernel."""
    if kernel_name() == "rust":
        return
    skipped = [
        report for report in terminalreporter.stats.get("skipped", ()) if "compiled" in str(report.longrepr)
    ]
    terminalreporter.write_line(f"no compiled kernel: {len(skipped)} tests of the compiled engines skipped")
