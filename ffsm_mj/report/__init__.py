"""Reports of a finished run: figures, text, tables, videos."""
