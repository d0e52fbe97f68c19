"""A finished run as data: columns, verdicts on conservation, tables, summary, comparison."""
