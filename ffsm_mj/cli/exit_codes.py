"""Exit codes of the command line."""

from __future__ import annotations

OK, CHECK_FAILED, BAD_INPUT, RUN_FAILED, DAMAGED, TRUNCATED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
OUTPUT_LOST = RUN_FAILED

EXIT_CODES = (
    f"exit codes: {OK} done; {CHECK_FAILED} a check fails (run, analyze), a log disagrees with its states (analyze), "
    "or a page is stale (reproduce --check); "
    f"{BAD_INPUT} bad input; {RUN_FAILED} the run failed (log kept), or output was lost (full disk); "
    f"{DAMAGED} analyze, export: the log is damaged or incomplete; "
    f"{TRUNCATED} checks fail by the truncation of the step alone (run, analyze); {INTERRUPTED} interrupted (log kept)"
)
