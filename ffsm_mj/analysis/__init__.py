"""A finished run as data: columns, checks, tables, summary, comparison."""
